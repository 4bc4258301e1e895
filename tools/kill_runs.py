#!/usr/bin/env python3
"""Kills runs at random moments, resumes them, and compares what they leave with a run in one go.

    tools/kill_runs.py bin/calor --count 200 --seed 1

Each run is killed (kill -9) after a random time. Then its output file, if there is one in its place,
must open: by h5dump, and by VTK's reader where .venv-vtk is. The run goes on from its last checkpoint, or
from the start where there is none yet, and in the end all data sets and attributes of the output but
the wall times must be those of the run without a break, by h5diff. Exit status: 0 all as expected,
1 something differs (a line says what).
"""

import argparse
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

SCENES = {
    "plate": """&domain x_range = 0, 1  y_range = 0, 1  spacing = 0.025  arrangement = 'jittered' /
&initial temperature_expression = 'sin(pi*x)*sin(pi*y)' /
&boundary value_expression = '0.1*sin(40*t)' /
&time end = 0.2  method = 'rkl2'  tolerance = 1e-8 /
&output file = 'o.vtkhdf'  every = 0.001 /
&checkpoint every_seconds = 0.02  keep = 2 /
""",
    "flow": """&domain shape = 'disc'  radius = 1  spacing = 0.1 /
&initial temperature_expression = 'exp(-10*((x-0.3)^2+y^2))' /
&boundary kind = 'convection'  coefficient = 1  ambient = 0 /
&motion velocity_x_expression = '-3*y*(1+0.5*(x^2+y^2))'
        velocity_y_expression = '3*x*(1+0.5*(x^2+y^2))'  shifting = .true. /
&time end = 0.5 /
&output file = 'o.vtkhdf'  every = 0.005 /
&checkpoint every = 0.003 /
""",
}
ROOT = pathlib.Path(__file__).resolve().parent.parent
VTK = ROOT / ".venv-vtk" / "bin" / "python"


def call(command, folder):
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env=environment)


def fail(text, outcome=None):
    print("kill_runs: " + text)
    if outcome is not None:
        print(outcome.stdout[-2000:] + outcome.stderr[-2000:])
    sys.exit(1)


def check_readable(folder, vtk):
    """What is under the output's name is a whole file."""
    if not (folder / "o.vtkhdf").exists():
        return 0
    outcome = call(["h5dump", "o.vtkhdf"], folder)
    if outcome.returncode:
        fail("h5dump does not read the file", outcome)
    if vtk:
        outcome = call([str(VTK), str(ROOT / "tools" / "check_vtk.py"), "o.vtkhdf"], folder)
        if outcome.returncode:
            fail("VTK does not read the file", outcome)
    return 1


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--count", type=int, default=200, help="how often to kill")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    program = str(pathlib.Path(asked.program).resolve())
    chance = random.Random(asked.seed)
    vtk = VTK.exists()
    kills = read = runs = 0
    scratch = pathlib.Path(tempfile.mkdtemp(prefix="calor-"))
    whole, seconds = {}, {}
    for name, scene in SCENES.items():
        whole[name] = scratch / name
        whole[name].mkdir()
        (whole[name] / "s.nml").write_text(scene)
        start = time.monotonic()
        outcome = call([program, "run", "--quiet", "s.nml"], whole[name])
        seconds[name] = time.monotonic() - start
        if outcome.returncode:
            fail("the run without a break fails", outcome)
    while kills < asked.count:
        name = list(SCENES)[runs % len(SCENES)]
        folder = scratch / "broken"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / "s.nml").write_text(SCENES[name])
        while True:
            command = [program, "run", "--quiet"]
            if (folder / "o.checkpoint.h5").exists():
                command.append("--resume")
            environment = {**os.environ, "OMP_NUM_THREADS": "1"}
            process = subprocess.Popen(command + ["s.nml"], cwd=folder, env=environment,
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            try:
                limit = None if kills >= asked.count else chance.uniform(0, 1.2) * seconds[name]
                output, errors = process.communicate(timeout=limit)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
                kills += 1
                read += check_readable(folder, vtk)
                continue
            if process.returncode:
                fail(f"after kill {kills} of {name}: {errors}")
            break
        runs += 1
        outcome = call(["h5diff", "--exclude-path", "/calor/wall_time",
                        str(whole[name] / "o.vtkhdf"), "o.vtkhdf"], folder)
        if outcome.returncode:
            fail(f"the resumed run of {name} differs", outcome)
    shutil.rmtree(scratch)
    print(f"{kills} kills, {runs} runs resumed to the same end; {read} files found in their place, all "
          f"read by h5dump{' and VTK' if vtk else ''}")


if __name__ == "__main__":
    main()
