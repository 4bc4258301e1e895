#!/usr/bin/env python3
"""Opens an output file with VTK's own reader, step by step, and compares it with expectations.

    tools/check_vtk.py plate.vtkhdf --times 0,0.01,0.02 --minimum 0 --maximum 'exp(-2*pi^2*t)'

A line per step tells what the reader found. Exit status: 0 all as expected, 1 something differs (a line
says what), 2 the command line is wrong. Whatever is asked for or not, every step must have points,
one cell per point, and one finite value of the field per point.
"""

import argparse
import math
import sys

from vtkmodules.vtkCommonCore import vtkCommand
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline
from vtkmodules.vtkIOHDF import vtkHDFReader


class Difference(Exception):
    """What the file holds is not what was expected."""


def formula(text):
    """The function of t that `text` writes down, for instance 'exp(-2*pi^2*t)'."""
    code = compile(text.replace("^", "**"), "expectation", "eval")
    names = {name: getattr(math, name) for name in ("exp", "sin", "cos", "sqrt", "pi")}
    return lambda t: float(eval(code, {"__builtins__": {}}, {**names, "t": t}))


def numbers(text):
    return [float(word) for word in text.split(",")]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--field", default="temperature", help="point data to look at")
    parser.add_argument("--steps", type=int, help="number of steps")
    parser.add_argument("--points", type=int, help="number of points, the same in every step")
    parser.add_argument("--times", type=numbers, help="time of every step, separated by commas")
    parser.add_argument("--minimum", type=formula, help="smallest value, as a formula in t")
    parser.add_argument("--maximum", type=formula, help="largest value, as a formula in t")
    parser.add_argument("--tolerance", type=float, default=1e-6,
                        help="allowed difference of minimum and maximum (default %(default)s)")
    return parser.parse_args()


def open_file(path):
    """A reader that has looked at the file, and the list into which its complaints go."""
    reader = vtkHDFReader()
    complaints = []
    for event in (vtkCommand.ErrorEvent, vtkCommand.WarningEvent):
        reader.AddObserver(event, lambda *_: complaints.append("VTK's reader complains"))
        reader.GetExecutive().AddObserver(event, lambda *_: complaints.append("VTK's pipeline complains"))
    if not reader.CanReadFile(path):
        raise Difference(f"{path} is not a file that VTK's reader takes for VTKHDF")
    reader.SetFileName(path)
    reader.UpdateInformation()
    return reader, complaints


def times_of(reader):
    """The time of every step as the reader announces it to whoever is downstream (ParaView)."""
    information = reader.GetExecutive().GetOutputInformation(0)
    key = Pipeline.TIME_STEPS()
    return [information.Get(key, k) for k in range(information.Length(key))]


def near(a, b, tolerance):
    return math.isfinite(a) and abs(a - b) <= tolerance


def check_step(reader, wanted, k, time):
    """Reads step `k`, prints what is there and raises `Difference` where it is not as expected."""
    reader.SetStep(k)
    reader.Update()
    grid = reader.GetOutput()
    points, cells = grid.GetNumberOfPoints(), grid.GetNumberOfCells()
    array = grid.GetPointData().GetArray(wanted.field)
    if array is None:
        raise Difference(f"step {k} has no point data '{wanted.field}'")
    low, high = array.GetRange()
    print(f"step {k}: t = {time:.9g}, {points} points, {wanted.field} from {low:.9g} to {high:.9g}")

    if points == 0 or cells != points or array.GetNumberOfTuples() != points:
        raise Difference(f"step {k}: {points} points, {cells} cells, "
                         f"{array.GetNumberOfTuples()} values; they should be as many")
    if wanted.points is not None and points != wanted.points:
        raise Difference(f"step {k}: {points} points instead of {wanted.points}")
    if not near(reader.GetTimeValue(), time, 1e-12 * max(1.0, abs(time))):
        raise Difference(f"step {k}: read as t = {reader.GetTimeValue()}, announced as t = {time}")
    if not all(math.isfinite(array.GetValue(i)) for i in range(points)):
        raise Difference(f"step {k}: {wanted.field} is not finite everywhere")
    for name, found, expected in (("minimum", low, wanted.minimum), ("maximum", high, wanted.maximum)):
        if expected is not None and not near(found, expected(time), wanted.tolerance):
            raise Difference(f"step {k}: {name} {found} instead of {expected(time)} "
                             f"(allowed difference {wanted.tolerance})")


def check(wanted):
    reader, complaints = open_file(wanted.file)
    count = reader.GetNumberOfSteps()
    times = times_of(reader)
    if count < 1 or len(times) != count:
        raise Difference(f"{count} steps with {len(times)} times")
    if wanted.steps is not None and count != wanted.steps:
        raise Difference(f"{count} steps instead of {wanted.steps}")
    if any(later <= earlier for earlier, later in zip(times, times[1:])):
        raise Difference(f"the times do not increase: {times}")
    if wanted.times is not None:
        if len(wanted.times) != count:
            raise Difference(f"{count} steps instead of {len(wanted.times)}: {times}")
        for k, (found, expected) in enumerate(zip(times, wanted.times)):
            if not near(found, expected, 1e-9 * max(1.0, abs(expected))):
                raise Difference(f"step {k}: t = {found} instead of {expected}")
    for k, time in enumerate(times):
        check_step(reader, wanted, k, time)
        if complaints:
            raise Difference(f"step {k}: {complaints[0]}")
    return count


def main():
    wanted = arguments()
    try:
        count = check(wanted)
    except Difference as difference:
        print(f"check_vtk: {wanted.file}: {difference}", file=sys.stderr)
        return 1
    print(f"check_vtk: {wanted.file}: {count} steps as expected")
    return 0


if __name__ == "__main__":
    sys.exit(main())
