// What OpenVDB takes to hold a set's visible voxels: build time, bytes in memory and of the file, time to visit them.
//
//   openvdb_hold FOLDER NX NY NZ FILE.vdb
//
// FOLDER has codes.raw and look.txt (256 lines, the first number the opacity). The visible voxels are the active ones of
// a FloatGrid, which is what people use (its file as 16-bit floats), and of a grid of bytes in a tree of the same shape,
// which is the smallest that its templates give and is no type that it ships. The input is read before the clock starts.
// Visiting sums the values in the tree's own order: OpenVDB has no visibility order. One thread. Prints JSON.

#include <openvdb/openvdb.h>
#include <openvdb/tools/Prune.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <string>
#include <sys/stat.h>
#include <vector>

namespace {

using ByteGrid = openvdb::Grid<openvdb::tree::Tree4<uint8_t, 5, 4, 3>::Type>;

double now_ms()
{
    using namespace std::chrono;
    return duration<double, std::milli>(steady_clock::now().time_since_epoch()).count();
}

struct Dims {
    int x, y, z;
};

// Fills a grid with the visible voxels, row by row, as the codes lie in the file.
template <typename Grid>
typename Grid::Ptr filled(const std::vector<uint8_t>& codes, Dims dims, const bool (&visible)[256])
{
    auto grid = Grid::create();
    auto accessor = grid->getAccessor();
    size_t at = 0;
    for (int z = 0; z < dims.z; z++)
        for (int y = 0; y < dims.y; y++)
            for (int x = 0; x < dims.x; x++, at++)
                if (visible[codes[at]])
                    accessor.setValue(openvdb::Coord(x, y, z), typename Grid::ValueType(codes[at]));
    // Blocks of one value become a tile.
    openvdb::tools::prune(grid->tree());
    return grid;
}

long long bytes_of(const std::string& path)
{
    struct stat about;
    return stat(path.c_str(), &about) == 0 ? about.st_size : -1;
}

template <typename Grid>
void measure(const char* name, const std::vector<uint8_t>& codes, Dims dims, const bool (&visible)[256],
    const std::string& file, bool half)
{
    double start = now_ms();
    auto grid = filled<Grid>(codes, dims, visible);
    const double build_ms = now_ms() - start;

    // The best of a few visits; the sum is printed so that none is skipped.
    double visit_ms = 1e30, sum = 0.0;
    for (int repeat = 0; repeat < 5; repeat++) {
        start = now_ms();
        sum = 0.0;
        for (auto iterator = grid->cbeginValueOn(); iterator; ++iterator)
            sum += double(*iterator) * double(iterator.getVoxelCount());
        visit_ms = std::min(visit_ms, now_ms() - start);
    }

    grid->setSaveFloatAsHalf(half);
    start = now_ms();
    {
        openvdb::io::File out(file);
        out.setCompression(openvdb::io::COMPRESS_ACTIVE_MASK | openvdb::io::COMPRESS_BLOSC);
        out.write({grid});
    }
    const double write_ms = now_ms() - start;
    std::printf("\"%s\": {\"build_ms\": %.3f, \"bytes\": %llu, \"file_bytes\": %lld, \"write_ms\": %.3f, "
                "\"visit_ms\": %.3f, \"visible\": %llu, \"sum\": %.0f}",
        name, build_ms, (unsigned long long)grid->memUsage(), bytes_of(file), write_ms, visit_ms,
        (unsigned long long)grid->activeVoxelCount(), sum);
}

} // namespace

int main(int count, char** words)
{
    if (count != 6) {
        std::cerr << "openvdb_hold: needs FOLDER NX NY NZ FILE.vdb\n";
        return 2;
    }
    const std::string folder = words[1];
    const Dims dims{std::stoi(words[2]), std::stoi(words[3]), std::stoi(words[4])};
    std::vector<uint8_t> codes(size_t(dims.x) * dims.y * dims.z);
    std::ifstream raw(folder + "/codes.raw", std::ios::binary);
    if (!raw.read(reinterpret_cast<char*>(codes.data()), std::streamsize(codes.size()))) {
        std::cerr << "openvdb_hold: codes.raw is too short\n";
        return 2;
    }
    bool visible[256];
    std::ifstream look(folder + "/look.txt");
    for (bool& one : visible) {
        double opacity, red, green, blue;
        if (!(look >> opacity >> red >> green >> blue)) {
            std::cerr << "openvdb_hold: look.txt needs 256 lines of 4 numbers\n";
            return 2;
        }
        one = opacity > 0.0;
    }
    openvdb::initialize();
    std::printf("{");
    measure<ByteGrid>("byte", codes, dims, visible, words[5], false);
    std::printf(", ");
    measure<openvdb::FloatGrid>("float", codes, dims, visible, words[5], true);
    std::printf("}\n");
    return 0;
}
