/* VolPack's shear-warp over a turn of views: build time, bytes, time a picture.
 *
 *   volpack_render FOLDER NX NY NZ SX SY SZ SIZE MAX_RAY_OPACITY grey|colour REPEATS PICTURE
 *
 * FOLDER has codes.raw, look.txt (256 lines: opacity and linear red green blue) and views.txt (a line a view: right,
 * up, forward, centre, height). Prints JSON. The volume is classified once (run-length encoded for all three axes); then
 * each view gets its shading table, and only vpRenderClassifiedVolume is timed, the best of REPEATS, the table beside it.
 * The colour form shades three materials, red, green and blue, mixed by the voxel's code. VolPack works in one thread.
 */

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <sys/stat.h>
#include <unistd.h>
#include <volpack.h>

typedef struct {
    unsigned short normal;
    unsigned char code;
    unsigned char unused;
} Voxel;

enum { NORMAL_FIELD, CODE_FIELD, FIELDS };
enum { CODES = 256, MOST_VIEWS = 256 };

static double now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1e3 + t.tv_nsec * 1e-6;
}

static void fail(const char *what)
{
    fprintf(stderr, "volpack_render: %s\n", what);
    exit(2);
}

static void check(vpContext *context, vpResult result, const char *what)
{
    if (result != VP_OK) {
        fprintf(stderr, "volpack_render: %s: %s\n", what, vpGetErrorString(vpGetError(context)));
        exit(2);
    }
}

static FILE *opened(const char *folder, const char *name)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "rb");
    if (!file)
        fail(path);
    return file;
}

static void set_material(vpContext *context, int material, int red, int green, int blue)
{
    /* Weights are those of adj's lighting; VolPack's colours are 0 to 1. */
    vpSetMaterial(context, material, VP_AMBIENT, VP_BOTH_SIDES, 0.25 * red, 0.25 * green, 0.25 * blue);
    vpSetMaterial(context, material, VP_DIFFUSE, VP_BOTH_SIDES, 0.75 * red, 0.75 * green, 0.75 * blue);
    vpSetMaterial(context, material, VP_SPECULAR, VP_BOTH_SIDES, 0.2 * red, 0.2 * green, 0.2 * blue);
    vpSetMaterial(context, material, VP_SHINYNESS, VP_BOTH_SIDES, 24.0, 0.0, 0.0);
}

int main(int count, char **words)
{
    if (count != 13)
        fail("needs FOLDER NX NY NZ SX SY SZ SIZE MAX_RAY_OPACITY grey|colour REPEATS PICTURE");
    const char *folder = words[1];
    int dims[3] = {atoi(words[2]), atoi(words[3]), atoi(words[4])};
    double spacing[3] = {atof(words[5]), atof(words[6]), atof(words[7])};
    int size = atoi(words[8]);
    double most_opacity = atof(words[9]);
    int repeats = atoi(words[11]);
    int colour = strcmp(words[10], "colour") == 0;

    size_t voxels = (size_t)dims[0] * dims[1] * dims[2];
    unsigned char *codes = malloc(voxels);
    FILE *file = opened(folder, "codes.raw");
    if (!codes || fread(codes, 1, voxels, file) != voxels)
        fail("codes.raw is too short");
    fclose(file);

    float opacity[CODES], weights[CODES][3];
    file = opened(folder, "look.txt");
    for (int code = 0; code < CODES; code++)
        if (fscanf(file, "%f %f %f %f", &opacity[code], &weights[code][0], &weights[code][1], &weights[code][2]) != 4)
            fail("look.txt needs 256 lines of 4 numbers");
    fclose(file);
    /* VolPack lights and writes colours as they are: sRGB, which its pictures are shown as. */
    for (int code = 0; code < CODES; code++)
        for (int part = 0; part < 3; part++) {
            float c = weights[code][part];
            weights[code][part] = c <= 0.0031308f ? 12.92f * c : 1.055f * powf(c, 1.0f / 2.4f) - 0.055f;
        }

    Voxel *none = NULL;
    vpContext *context = vpCreateContext();
    check(context, vpSetVolumeSize(context, dims[0], dims[1], dims[2]), "volume size");
    /* Both fields are for shading; the code is for classifying too. */
    check(context, vpSetVoxelSize(context, sizeof(Voxel), FIELDS, 2, 1), "voxel size");
    vpSetVoxelField(context, NORMAL_FIELD, sizeof(unsigned short), vpFieldOffset(none, normal), VP_NORM_MAX);
    vpSetVoxelField(context, CODE_FIELD, sizeof(unsigned char), vpFieldOffset(none, code), CODES - 1);
    check(context, vpSetClassifierTable(context, 0, CODE_FIELD, opacity, sizeof opacity), "opacities");

    double start = now_ms();
    check(context, vpClassifyScalars(context, codes, (int)voxels, CODE_FIELD, VP_SKIP_FIELD, NORMAL_FIELD), "classify");
    double build_ms = now_ms() - start;
    free(codes);

    /* What it holds, as it writes it: the only count of bytes that it gives. */
    char stored[4096];
    snprintf(stored, sizeof stored, "%s/classified-XXXXXX", folder);
    int out = mkstemp(stored);
    if (out < 0)
        fail(stored);
    check(context, vpStoreClassifiedVolume(context, out), "store");
    struct stat about;
    fstat(out, &about);
    close(out);
    unlink(stored);

    int channels = colour ? 3 : 1, materials = colour ? 3 : 1;
    float *shades = malloc((VP_NORM_MAX + 1) * sizeof(float) * channels * materials);
    int shades_bytes = (VP_NORM_MAX + 1) * (int)sizeof(float) * channels * materials;
    if (colour) {
        check(context,
            vpSetLookupShader(context, 3, 3, NORMAL_FIELD, shades, shades_bytes, CODE_FIELD, &weights[0][0], sizeof weights),
            "shader");
        set_material(context, VP_MATERIAL0, 1, 0, 0);
        set_material(context, VP_MATERIAL1, 0, 1, 0);
        set_material(context, VP_MATERIAL2, 0, 0, 1);
    } else {
        check(context, vpSetLookupShader(context, 1, 1, NORMAL_FIELD, shades, shades_bytes, 0, NULL, 0), "shader");
        set_material(context, VP_MATERIAL0, 1, 1, 1);
    }
    vpCurrentMatrix(context, VP_MODEL);
    vpIdentityMatrix(context);
    /* Where the light goes, not where it comes from; depth rises away from the eye. */
    vpSetLight(context, VP_LIGHT0, VP_DIRECTION, 0.35, -0.45, 1.0);
    vpSetLight(context, VP_LIGHT0, VP_COLOR, 1.0, 1.0, 1.0);
    vpEnable(context, VP_LIGHT0, 1);
    vpSetd(context, VP_MAX_RAY_OPACITY, most_opacity);
    vpCurrentMatrix(context, VP_PROJECT);
    vpIdentityMatrix(context);
    vpWindow(context, VP_PARALLEL, -0.5, 0.5, -0.5, 0.5, -0.5, 0.5);

    unsigned char *picture = calloc((size_t)size * size, channels);
    check(context, vpSetImage(context, picture, size, size, size * channels, colour ? VP_RGB : VP_LUMINANCE), "image");

    int longest = dims[0] > dims[1] ? dims[0] : dims[1];
    longest = dims[2] > longest ? dims[2] : longest;
    double frame_ms[MOST_VIEWS], table_ms[MOST_VIEWS];
    int views = 0;
    file = opened(folder, "views.txt");
    double v[13];
    while (views < MOST_VIEWS) {
        int read = 0;
        while (read < 13 && fscanf(file, "%lf", &v[read]) == 1)
            read++;
        if (read < 13)
            break;
        /* From VolPack's volume, whose longest side is 1 and whose middle is the origin, to a picture of height 1. */
        vpMatrix4 matrix;
        memset(matrix, 0, sizeof matrix);
        for (int row = 0; row < 3; row++) {
            double moved = 0.0;
            for (int axis = 0; axis < 3; axis++) {
                double part = v[3 * row + axis];
                matrix[row][axis] = part * longest * spacing[axis] / v[12];
                moved += part * (0.5 * (dims[axis] - 1) * spacing[axis] - v[9 + axis]);
            }
            matrix[row][3] = moved / v[12];
        }
        matrix[3][3] = 1.0;
        vpCurrentMatrix(context, VP_MODEL);
        check(context, vpSetMatrix(context, matrix), "matrix");
        double began = now_ms();
        check(context, vpShadeTable(context), "shading table");
        table_ms[views] = now_ms() - began;
        double best = 1e30;
        for (int repeat = 0; repeat < repeats; repeat++) {
            began = now_ms();
            check(context, vpRenderClassifiedVolume(context), "render");
            double took = now_ms() - began;
            best = took < best ? took : best;
        }
        frame_ms[views++] = best;
        char path[4096];
        snprintf(path, sizeof path, "%s-%03d.%s", words[12], views - 1, colour ? "ppm" : "pgm");
        FILE *written = fopen(path, "wb");
        if (!written)
            fail(path);
        fprintf(written, "P%d\n%d %d\n255\n", colour ? 6 : 5, size, size);
        /* VolPack's rows rise. */
        for (int row = size - 1; row >= 0; row--)
            fwrite(picture + (size_t)row * size * channels, channels, size, written);
        fclose(written);
    }
    fclose(file);

    printf("{\"build_ms\": %.3f, \"bytes\": %lld, \"frame_ms\": [", build_ms, (long long)about.st_size);
    for (int view = 0; view < views; view++)
        printf("%s%.4f", view ? ", " : "", frame_ms[view]);
    printf("], \"table_ms\": [");
    for (int view = 0; view < views; view++)
        printf("%s%.4f", view ? ", " : "", table_ms[view]);
    printf("]}\n");
    return 0;
}
