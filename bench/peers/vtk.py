#!/usr/bin/env python3
"""The same picture by VTK: flying edges, its OpenGL polygons, its PNG writer.

    apt-get install -y --no-install-recommends python3-vtk9 python3-numpy xvfb
    isoscope-bench frame VOLUME --isovalue V --peer bench/peers/vtk.py

or by itself, on raw samples, x fastest, little endian:

    xvfb-run -a -s '-screen 0 1280x1024x24' /usr/bin/python3 vtk.py FILE.raw --dims X,Y,Z --type uint8 --isovalue V

The camera is that of `isoscope render --azimuth 30 --elevation 20 --orbit 7`: it frames the sphere around the volume,
with an angle of view of 30 degrees. Prints one JSON object. Times are milliseconds by the wall clock:

    extract_ms            flying edges with normals, first run
    first_draw_ms         upload, shaders, first picture
    next_draw_ms          median of the views after it
    png_ms                median; reading the window back included
    cold_total            extract_ms + first_draw_ms + the first PNG
    next_total            medians of drawing and PNG together
    triangles, vertices, vtk, smp_backend, threads, opengl

Reading the file and starting the window are not in any of them.
"""
import argparse
import json
import statistics
import sys
import time

sys.path.pop(0)  # this folder: its vtk.py is not VTK
import numpy  # noqa: E402
import vtk  # noqa: E402
from vtk.util.numpy_support import numpy_to_vtk  # noqa: E402


def numbers(kind, count):
    def parse(text):
        values = tuple(kind(part) for part in text.split(','))
        if len(values) != count:
            raise argparse.ArgumentTypeError(f"'{text}' is not {count} numbers with commas")
        return values
    return parse


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file')
    parser.add_argument('--dims', type=numbers(int, 3), required=True)
    parser.add_argument('--type', required=True, help='a numpy type, as uint8')
    parser.add_argument('--spacing', type=numbers(float, 3), default=(1.0, 1.0, 1.0))
    parser.add_argument('--isovalue', type=float, required=True)
    parser.add_argument('--size', type=int, default=1024)
    parser.add_argument('--frames', type=int, default=6)
    parser.add_argument('--azimuth', type=float, default=30.0)
    parser.add_argument('--elevation', type=float, default=20.0)
    parser.add_argument('--orbit', type=float, default=7.0)
    parser.add_argument('--png', default='/dev/null', help='where the pictures go, one over the other')
    return parser.parse_args()


def read_image(arguments):
    samples = numpy.fromfile(arguments.file, dtype=numpy.dtype(arguments.type).newbyteorder('<'))
    wanted = int(numpy.prod(arguments.dims))
    if samples.size != wanted:
        sys.exit(f'{arguments.file}: {samples.size} samples, --dims asks for {wanted}')
    image = vtk.vtkImageData()
    image.SetDimensions(*arguments.dims)
    image.SetSpacing(*arguments.spacing)
    image.GetPointData().SetScalars(numpy_to_vtk(samples, deep=0))
    return image, samples  # VTK borrows the samples


def milliseconds(function):
    start = time.perf_counter()
    function()
    return 1e3 * (time.perf_counter() - start)


class Scene:
    """A window of the surface, seen from a camera that turns about up."""

    def __init__(self, bounds, surface, arguments):
        self.bounds = bounds
        self.window = vtk.vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(0)
        self.window.SetSize(arguments.size, arguments.size)
        self.renderer = vtk.vtkRenderer()
        self.window.AddRenderer(self.renderer)
        self.window.Render()  # starts the context before any clock runs
        mapper = vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(surface)
        mapper.ScalarVisibilityOff()
        actor = vtk.vtkActor()
        actor.SetMapper(mapper)
        self.renderer.AddActor(actor)
        self.renderer.ResetCamera(bounds)
        self.camera = self.renderer.GetActiveCamera()
        self.turn(arguments.azimuth)
        self.camera.Elevation(arguments.elevation)
        self.camera.OrthogonalizeViewUp()
        self.renderer.ResetCameraClippingRange(bounds)
        self.png = arguments.png

    def turn(self, degrees):
        self.camera.Azimuth(degrees)
        self.renderer.ResetCameraClippingRange(self.bounds)

    def draw(self):
        self.window.Render()
        self.window.GetZbufferDataAtPoint(0, 0)  # returns once the rasteriser has finished

    def encode(self):
        reader = vtk.vtkWindowToImageFilter()
        reader.SetInput(self.window)
        reader.ReadFrontBufferOff()
        reader.ShouldRerenderOff()
        writer = vtk.vtkPNGWriter()
        writer.SetInputConnection(reader.GetOutputPort())
        writer.SetFileName(self.png)
        writer.Write()

    def opengl(self):
        lines = self.window.ReportCapabilities().splitlines()
        return next((line.split(':', 1)[1].strip() for line in lines if line.startswith('OpenGL renderer')), '')


def main():
    arguments = parse_arguments()
    image, _samples = read_image(arguments)
    contour = vtk.vtkFlyingEdges3D()
    contour.SetInputData(image)
    contour.SetValue(0, arguments.isovalue)
    contour.ComputeNormalsOn()
    contour.ComputeScalarsOff()
    extract = milliseconds(contour.Update)

    scene = Scene(image.GetBounds(), contour.GetOutputPort(), arguments)
    first_draw, first_png = milliseconds(scene.draw), milliseconds(scene.encode)
    draws, pngs = [], []
    for _ in range(arguments.frames - 1):
        scene.turn(arguments.orbit)
        draws.append(milliseconds(scene.draw))
        pngs.append(milliseconds(scene.encode))
    following = [draw + png for draw, png in zip(draws, pngs)]
    result = {
        'extract_ms': extract,
        'first_draw_ms': first_draw,
        'next_draw_ms': statistics.median(draws) if draws else None,
        'png_ms': statistics.median([first_png] + pngs),
        'cold_total': extract + first_draw + first_png,
        'next_total': statistics.median(following) if following else None,
        'triangles': contour.GetOutput().GetNumberOfPolys(),
        'vertices': contour.GetOutput().GetNumberOfPoints(),
        'vtk': vtk.vtkVersion.GetVTKVersion(),
        'smp_backend': vtk.vtkSMPTools.GetBackend(),
        'threads': vtk.vtkSMPTools.GetEstimatedNumberOfThreads(),
        'opengl': scene.opengl(),
    }
    print(json.dumps({key: round(value, 3) if isinstance(value, float) else value for key, value in result.items()}))


if __name__ == '__main__':
    main()
