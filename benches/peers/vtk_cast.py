"""VTK's fixed-point ray caster over a turn of views: build time, bytes, time a picture.

    python vtk_cast.py FOLDER SIZE THREADS parallel|perspective REPEATS PICTURE

Prints JSON. Composite with shading, a sample a voxel along each ray, a ray a pixel, no automatic coarsening. Timed is
the ray casting alone, without the texture that brings the picture to a window. Gradients, the opacity tables and the
space leaping volume are made once: their time is the build's.
"""

import ctypes
import json
import sys
import time
from pathlib import Path

import numpy
import vtk
from vtk.util.numpy_support import numpy_to_vtk

import views

LIGHTING = {"ambient": 0.25, "diffuse": 0.75, "specular": 0.2, "shininess": 24, "toward_light": (-0.35, 0.45, 1.0)}


def srgb(look):
    """sRGB components, which is what VTK interpolates and lights, of linear ones."""
    return numpy.where(look <= 0.0031308, 12.92 * look, 1.055 * look ** (1 / 2.4) - 0.055)


def resident_bytes():
    """Memory that this process has now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def volume_of(folder, described):
    """The codes as an image, and what they look like."""
    codes = numpy.fromfile(folder / "codes.raw", "u1")
    image = vtk.vtkImageData()
    image.SetDimensions(described["dims"])
    image.SetSpacing(described["spacing"])
    image.GetPointData().SetScalars(numpy_to_vtk(codes, deep=False))
    look = numpy.loadtxt(folder / "look.txt")
    colours = srgb(look[:, 1:])
    opacity, colour = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
    first, last = described["first"], min(described["last"], 255)
    # Steps half way between a visible code and one that is not.
    opacity.AddPoint(first - 0.51, 0.0)
    opacity.AddPoint(first - 0.49, look[first, 0])
    opacity.AddPoint(min(last, int(codes.max())) + 0.49, look[first, 0])
    opacity.AddPoint(min(last, int(codes.max())) + 0.51, 0.0)
    for code in range(first, last + 1):
        colour.AddRGBPoint(code, *colours[code])
    looks = vtk.vtkVolumeProperty()
    looks.SetScalarOpacity(opacity)
    looks.SetColor(colour)
    looks.ShadeOn()
    looks.SetAmbient(LIGHTING["ambient"])
    looks.SetDiffuse(LIGHTING["diffuse"])
    looks.SetSpecular(LIGHTING["specular"])
    looks.SetSpecularPower(LIGHTING["shininess"])
    # Between labels there is nothing to interpolate.
    looks.SetInterpolationType(vtk.VTK_NEAREST_INTERPOLATION if described["labels"] else vtk.VTK_LINEAR_INTERPOLATION)
    mean = float(numpy.prod(described["spacing"])) ** (1 / 3)
    looks.SetScalarOpacityUnitDistance(mean)
    return codes, image, looks, mean


def picture(mapper, size):
    """The cast image over black, as rows of RGB from the top."""
    cast = mapper.GetRayCastImage()
    memory, used, origin = cast.GetImageMemorySize(), cast.GetImageInUseSize(), cast.GetImageOrigin()
    address = int(cast.GetImage().split("_")[1], 16)
    words = (ctypes.c_ushort * (memory[0] * memory[1] * 4)).from_address(address)
    pixels = numpy.frombuffer(words, "u2").reshape(memory[1], memory[0], 4)[: used[1], : used[0], :3]
    whole = numpy.zeros((size, size, 3))
    whole[origin[1] : origin[1] + used[1], origin[0] : origin[0] + used[0]] = pixels / 32767.0
    return (whole[::-1].clip(0, 1) * 255).astype("u1")


def main(folder, size, threads, projection, repeats, out):
    """One set, one size, one projection."""
    folder, size, threads = Path(folder), int(size), int(threads)
    described = json.loads((folder / "set.json").read_text())
    vtk.vtkMultiThreader.SetGlobalMaximumNumberOfThreads(threads)
    renderer = vtk.vtkRenderer()
    renderer.AutomaticLightCreationOff()
    light = vtk.vtkLight()
    light.SetLightTypeToCameraLight()
    light.SetPosition(*LIGHTING["toward_light"])
    light.SetFocalPoint(0, 0, 0)
    # Black unless set.
    light.SetAmbientColor(1, 1, 1)
    renderer.AddLight(light)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(size, size)
    window.AddRenderer(renderer)
    # The window's own memory and time do not count.
    window.Render()
    before = resident_bytes()

    codes, image, looks, mean = volume_of(folder, described)
    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetNumberOfThreads(threads)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.LockSampleDistanceToInputSpacingOff()
    mapper.SetSampleDistance(mean)
    mapper.SetInteractiveSampleDistance(mean)
    mapper.SetImageSampleDistance(1.0)
    mapper.IntermixIntersectingGeometryOff()
    mapper.SetInputData(image)
    volume = vtk.vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(looks)
    renderer.AddViewProp(volume)

    def cast():
        """Milliseconds of what the mapper does for a picture, without bringing it to the window."""
        began = time.perf_counter()
        mapper.PerImageInitialization(renderer, volume, 0, image.GetOrigin(), image.GetSpacing(), image.GetExtent())
        mapper.PerVolumeInitialization(renderer, volume)
        mapper.PerSubVolumeInitialization(renderer, volume, 0)
        mapper.RenderSubVolume()
        return (time.perf_counter() - began) * 1e3

    camera = renderer.GetActiveCamera()
    frame_ms, build_ms = [], None
    for frame, view in enumerate(views.turn(described)):
        camera.SetParallelProjection(projection == "parallel")
        camera.SetParallelScale(view["height"] / 2)
        camera.SetViewAngle(views.FOV)
        camera.SetPosition(view["eye"])
        camera.SetFocalPoint(view["centre"])
        camera.SetViewUp(view["up"])
        renderer.ResetCameraClippingRange()
        renderer.UpdateLightsGeometryToFollowCamera()
        first = cast() if build_ms is None else None
        frame_ms.append(min(cast() for _ in range(int(repeats))))
        if first is not None:
            # The first picture makes the gradients and the space leaping volume.
            build_ms = first - frame_ms[0]
        rows = picture(mapper, size)
        Path(f"{out}-{frame:03}.ppm").write_bytes(b"P6\n%d %d\n255\n" % (size, size) + rows.tobytes())
    result = {
        "version": vtk.vtkVersion.GetVTKVersion(),
        "threads": threads,
        "build_ms": build_ms,
        "bytes": resident_bytes() - before,
        "frame_ms": frame_ms,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:])
