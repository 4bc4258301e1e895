#!/usr/bin/env python3
"""Measures what set-up and steps of calor take, beside programs of others on the same cloud.

    bench/bench.py BENCH CALOR OUTPUT [SIZE]

BENCH is the measuring program (bench.f90), CALOR the program itself; OUTPUT a folder for
speed.csv, speed.md and speed.png. SIZE scales all numbers of particles (1: up to 4 million; 0.01
is good for trying). Measurements of one comparison alternate, round by round; what is told is the
median of the rounds. Nothing here fails because it is slow.
"""

import csv
import glob
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
import traceback

import numpy as np

ROUNDS = 5
SCHEMES = [  # name, order, support radius in spacings
    ("brookshaw", 0, 2.1),
    ("brookshaw_renormalized", 0, 2.1),
    ("kernel_second_derivative", 0, 2.1),
    ("fatehi_manzari", 0, 2.1),
    ("positive", 0, 2.1),
    ("consistent", 1, 1.45),
    ("consistent", 2, 1.9),
    ("consistent", 3, 2.35),
    ("consistent", 4, 2.8),
    ("consistent", 6, 3.7),
    ("consistent", 8, 4.6),
]

table = []  # section, item, particles, threads, neighbours, quantity, value, unit


def note(section, item, particles, threads, neighbours, quantity, value, unit):
    table.append((section, item, particles, threads, neighbours, quantity, value, unit))


def found(section, item, quantity, particles=None, threads=None):
    """The value noted, or not a number."""
    for row in table:
        if row[:2] == (section, item) and row[5] == quantity:
            if particles in (None, row[2]) and threads in (None, row[3]):
                return row[6]
    return math.nan


class Program:
    """The measuring program with a cloud, kept waiting for requests."""

    def __init__(self, path, intervals, threads):
        environment = dict(os.environ, OMP_NUM_THREADS=str(threads), MKL_NUM_THREADS=str(threads),
                           MKL_THREADING_LAYER="GNU", OPENBLAS_NUM_THREADS="1")
        libraries = os.path.join(sys.prefix, "lib")
        environment["LD_LIBRARY_PATH"] = libraries + ":" + environment.get("LD_LIBRARY_PATH", "")
        self.process = subprocess.Popen([path, str(intervals)], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True, env=environment)
        self.particles = int(self.process.stdout.readline())
        self.inside = (intervals - 1) ** 2
        self.threads = threads

    def ask(self, request):
        self.process.stdin.write(request + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split()
        return [float(word) for word in answer] if answer != ["written"] else []

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def in_turn(measurements, rounds=ROUNDS):
    """Medians of the first figure of several measurements, taken alternately, and what else the
    last call of each gave."""
    seconds = {name: [] for name in measurements}
    rest = {}
    for _ in range(rounds):
        for name, measure in measurements.items():
            answer = measure()
            seconds[name].append(answer[0])
            rest[name] = answer[1:]
    return {name: (statistics.median(values), rest[name]) for name, values in seconds.items()}


def timed(work):
    np.ones(60_000_000)  # memory from the host, as touch_memory in bench.f90
    begin = time.perf_counter()
    work()
    return [time.perf_counter() - begin]


def intervals_for(particles):
    return max(10, round(math.sqrt(particles)) - 1)


# --- What is measured ---------------------------------------------------------------------------


def measure_lists(bench, particles):
    """Lists of random points, beside scipy's k-d tree."""
    from scipy.spatial import cKDTree

    points = np.random.default_rng(7).random((particles, 2))
    radius = math.sqrt(20 / (math.pi * particles))
    for threads in (1, 2):
        program = Program(bench, 20, threads)
        tree = []

        def build():
            tree[:] = [cKDTree(points)]

        measurements = {
            "calor": lambda: program.ask(f"random {particles} 20"),
            "calor, points in Hilbert's order": lambda: program.ask(f"ordered {particles} 20"),
            "plain cell list": lambda: program.ask(f"plain {particles} 20"),
            "plain cell list, points in Hilbert's order": lambda: program.ask(
                f"plain_ordered {particles} 20"),
            "cKDTree build": lambda: timed(build),
            "cKDTree query_ball_point": lambda: timed(
                lambda: tree[0].query_ball_point(points, radius, workers=threads)),
        }
        if threads == 1:
            measurements["cKDTree query_pairs"] = lambda: timed(
                lambda: tree[0].query_pairs(radius, output_type="ndarray"))
        for name, (seconds, _) in in_turn(measurements).items():
            note("lists", name, particles, threads, 20, "seconds", seconds, "s")
        program.close()


def measure_schemes(bench, particles):
    """Lists, weights and whole rows of every scheme."""
    for threads in (1, 2):
        program = Program(bench, intervals_for(particles), threads)
        for name, order, support in SCHEMES:
            title = f"{name} {order}" if order else name
            results = in_turn({
                "lists": lambda: program.ask(f"lists {support}"),
                "weights": lambda: program.ask(f"weights {name} {order} {support}"),
                "rows": lambda: program.ask(f"rows {name} {order} {support}"),
            }, ROUNDS if support > 2.2 else 3 * ROUNDS)  # what takes milliseconds is disturbed most
            for work, (seconds, rest) in results.items():
                note(work, title, program.inside, threads, rest[0], "ns per particle",
                     1e9 * seconds / program.inside, "ns")
        program.close()


def measure_peer_weights(bench, particles, folder):
    """RBF-FD weights of the Laplacian with polyharmonic splines, searches included, and calor's rows
    of the same order, searches included, on the same cloud."""
    from rbf.pde.fd import weight_matrix

    program = Program(bench, intervals_for(particles), 1)
    path = os.path.join(folder, "cloud")
    program.ask("write " + path)
    points = np.fromfile(path).reshape(2, -1).T.copy()
    inner = points[((points > 0) & (points < 1)).all(axis=1)]
    for title, request, stencil, order in (
            ("order 2", "rows fatehi_manzari 0 2.1", 12, 2),
            ("order 4", "rows consistent 4 2.8", 30, 4)):
        results = in_turn({
            "calor": lambda: program.ask(request),
            "RBF-FD": lambda: timed(lambda: weight_matrix(inner, points, stencil, [[2, 0], [0, 2]],
                                                          phi="phs3" if order < 4 else "phs5",
                                                          order=order)),
        })
        for name, (seconds, _) in results.items():
            note("weights of others", f"{name}, {title}", len(inner), 1, stencil, "ns per particle",
                 1e9 * seconds / len(inner), "ns")
    program.close()


def measure_steps(bench, sizes):
    """A stage, a right-hand side and products of others, with a triad over as many bytes."""
    from scipy.sparse import csr_matrix

    library = sorted(glob.glob(os.path.join(sys.prefix, "lib", "libmkl_rt.so*")))
    for particles in sizes:
        for threads in (1, 2):
            program = Program(bench, intervals_for(particles), threads)
            for support in (2.1, 2.7):
                rest = program.ask(f"rows fatehi_manzari 0 {support}")[1:]
                names = ["triad", "stage", "forced", "rate", "csr"]
                if library and program.ask("mkl " + library[0]) == [1]:
                    names.append("product")
                measurements = {name: (lambda name=name: program.ask(name)) for name in names}
                if threads == 1 and particles == sizes[0]:
                    matrix, vector = read_matrix(program, csr_matrix)
                    measurements["scipy product"] = lambda: timed(lambda: matrix @ vector)
                item = f"{rest[0] + 1:.0f} entries"
                results = in_turn(measurements)
                # The same with weights in single precision, MKL's product again beside it
                program.ask("single")
                again = in_turn({name: measurements[name] for name in ("triad", "stage", "product")
                                 if name in measurements})
                program.ask("double")
                results.update({f"{name} (32-bit weights)" if name != "product" else
                                "product (beside 32-bit weights)": value
                                for name, value in again.items()})
                for name, (seconds, rest) in results.items():
                    note("steps", f"{name}, {item}", program.particles, threads, item, "ns per particle",
                         1e9 * seconds / program.particles, "ns")
                    if rest:
                        note("steps", f"{name}, {item}", program.particles, threads, item,
                             "bandwidth", rest[0] / seconds / 1e9, "GB/s")
            if threads == 2:
                now, most = program.ask("memory")
                note("memory", "measuring program, all arrays", program.particles, threads, 0,
                     "most", most / program.particles, "bytes per particle")
            program.close()


def read_matrix(program, csr_matrix):
    with tempfile.NamedTemporaryFile(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as file:
        program.ask("matrix " + file.name)
        raw = np.fromfile(file.name, dtype=np.uint8)
    rows, entries = raw[:16].view(np.int64)
    place = 16
    parts = []
    for length, kind in ((rows + 1, np.int64), (entries, np.int32), (entries, np.float64),
                         (rows, np.float64), (rows, np.int32)):
        size = int(length) * np.dtype(kind).itemsize
        parts.append(raw[place:place + size].copy().view(kind))
        place += size
    first, index, weight, diagonal, target = parts
    row_of = np.repeat(np.arange(rows), np.diff(first))
    matrix = csr_matrix(
        (np.concatenate([weight, diagonal]),
         (np.concatenate([row_of, np.arange(rows)]), np.concatenate([index, target]) - 1)),
        shape=(rows, program.particles))
    return matrix, np.ones(program.particles)


TRIAD = "triad over a stage's bytes"


def measure_growth(bench, sizes):
    """Set-up and a stage from small to large clouds."""
    for particles in sizes:
        program = Program(bench, intervals_for(particles), 2)
        results = in_turn({
            "fatehi_manzari": lambda: program.ask("rows fatehi_manzari 0 2.1"),
            "stage": lambda: program.ask("stage"),
            TRIAD: lambda: program.ask("triad"),
            "consistent 4": lambda: program.ask("rows consistent 4 2.8"),
        }, ROUNDS if particles < 2e6 else 3)
        for name, (seconds, _) in results.items():
            note("growth", name, program.particles, 2, 0, "seconds", seconds, "s")
        program.close()


def exponent(name):
    """Slope of log time over log particles, by least squares."""
    points = [(math.log(row[2]), math.log(row[6])) for row in table
              if row[0] == "growth" and row[1] == name]
    if len(points) < 2:
        return math.nan
    return float(np.polyfit([x for x, _ in points], [y for _, y in points], 1)[0])


# --- Time to a given error ----------------------------------------------------------------------

SCENE = """&scene exact_expression = 'sin(pi*x)*sin(pi*y)*exp(-2*pi^2*t)' /
&domain shape = 'rectangle' x_range = 0.0, 1.0 y_range = 0.0, 1.0 spacing = {spacing}
  arrangement = 'jittered' jitter = 0.2 seed = 1 /
&scheme laplacian = '{laplacian}' {order} /
&initial temperature_expression = 'sin(pi*x)*sin(pi*y)' /
&boundary on = 'all' kind = 'temperature' value = 0.0 /
&time end = 0.05 tolerance = {tolerance} /
"""

RUNS = [  # laplacian, order, intervals, tolerance
    ("fatehi_manzari", 0, 76, 1e-5),
    ("consistent", 4, 20, 1e-5),
    ("consistent", 4, 60, 1e-7),
    ("consistent", 6, 20, 1e-7),
    ("consistent", 6, 28, 1e-8),
    ("consistent", 8, 32, 1e-9),
    ("consistent", 8, 60, 1e-11),
]


def run_calor(calor, folder, laplacian, order, intervals, tolerance, arrangement="jittered"):
    scene = os.path.join(folder, f"{arrangement}_{laplacian}_{order}_{intervals}.nml")
    text = SCENE.format(spacing=1 / intervals, laplacian=laplacian, tolerance=tolerance,
                        order=f"order = {order}" if order else "")
    if arrangement == "lattice":
        text = text.replace("arrangement = 'jittered' jitter = 0.2 seed = 1", "arrangement = 'lattice'")
    with open(scene, "w") as file:
        file.write(text)
    text = subprocess.run([calor, "run", scene], capture_output=True, text=True,
                          env=dict(os.environ, OMP_NUM_THREADS="2")).stdout
    wall = re.search(r"Wall time +([0-9.e+-]+) s", text)
    error = re.search(r"relative L2 error ([0-9.e+-]+)", text)
    if not (wall and error):
        return [math.nan, math.nan]
    return [float(wall.group(1)), float(error.group(1))]


def run_elements(degree, intervals, steps):
    """Finite elements on triangles, Crank-Nicolson with factors kept."""
    import skfem
    from scipy.sparse.linalg import splu
    from skfem.models.poisson import laplace, mass

    begin = time.perf_counter()
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, intervals + 1), np.linspace(0, 1, intervals + 1))
    basis = skfem.Basis(mesh, skfem.ElementTriP1() if degree == 1 else skfem.ElementTriP2())
    stiffness, weight = laplace.assemble(basis), mass.assemble(basis)
    inner = basis.complement_dofs(basis.get_dofs())
    stiffness, weight = stiffness[inner][:, inner], weight[inner][:, inner]
    x, y = basis.doflocs[:, inner]
    u = np.sin(np.pi * x) * np.sin(np.pi * y)
    step = 0.05 / steps
    factors = splu((weight + 0.5 * step * stiffness).tocsc())
    explicit = weight - 0.5 * step * stiffness
    for _ in range(steps):
        u = factors.solve(explicit @ u)
    seconds = time.perf_counter() - begin
    exact = np.sin(np.pi * x) * np.sin(np.pi * y) * np.exp(-2 * np.pi ** 2 * 0.05)
    return [seconds, float(np.linalg.norm(u - exact) / np.linalg.norm(exact))]


def run_rbf(points, wall, stencil, order, steps):
    """RBF-FD with polyharmonic splines, Crank-Nicolson with factors kept."""
    from rbf.pde.fd import weight_matrix
    from scipy.sparse import identity
    from scipy.sparse.linalg import splu

    begin = time.perf_counter()
    inner = points[~wall]
    laplacian = weight_matrix(inner, points, stencil, [[2, 0], [0, 2]], phi="phs5", order=order)
    laplacian = laplacian.tocsr()[:, np.flatnonzero(~wall)]
    u = np.sin(np.pi * inner[:, 0]) * np.sin(np.pi * inner[:, 1])
    initial = u.copy()
    step = 0.05 / steps
    unit = identity(len(inner), format="csr")
    factors = splu((unit - 0.5 * step * laplacian).tocsc())
    explicit = unit + 0.5 * step * laplacian
    for _ in range(steps):
        u = factors.solve(explicit @ u)
    seconds = time.perf_counter() - begin
    exact = initial * np.exp(-2 * np.pi ** 2 * 0.05)
    return [seconds, float(np.linalg.norm(u - exact) / np.linalg.norm(exact))]


def measure_runs(bench, calor, folder):
    """Whole runs of the plate, set-up included, of calor and others."""
    program = Program(bench, 50, 1)
    path = os.path.join(folder, "cloud")
    program.ask("write " + path)
    program.close()
    points = np.fromfile(path).reshape(2, -1).T.copy()
    wall = (points == 0).any(axis=1) | (points == 1).any(axis=1)
    measurements = {}
    for laplacian, order, intervals, tolerance in RUNS:
        title = f"calor {laplacian} {order or ''} 1/{intervals}".replace("  ", " ")
        measurements[title] = lambda a=(laplacian, order, intervals, tolerance): run_calor(
            calor, folder, *a)
    for degree, intervals, steps in ((1, 64, 20), (2, 32, 100), (2, 64, 400)):
        measurements[f"scikit-fem P{degree} 1/{intervals}"] = (
            lambda a=(degree, intervals, steps): run_elements(*a))
    measurements["RBF-FD order 4, 2601 points"] = lambda: run_rbf(points, wall, 30, 4, 200)
    for title, (seconds, rest) in in_turn(measurements).items():
        note("runs", title, 0, 2, 0, "seconds", seconds, "s")
        note("runs", title, 0, 2, 0, "relative L2 error", rest[0], "")


LATTICE_RUNS = [  # order, intervals, tolerance
    (4, 24, 1e-6),
    (6, 12, 1e-6),
]
FIVE_POINT = 403  # intervals with which the plain loop has an error of 1e-5


def measure_lattice(bench, calor, folder, scale):
    """The plate on a lattice, beside forward Euler in a plain loop over five points."""
    intervals = max(20, round(FIVE_POINT * math.sqrt(scale)))
    program = Program(bench, 20, 2)
    measurements = {
        f"calor lattice {order} 1/{number}": lambda a=("consistent", order, number, tolerance): run_calor(
            calor, folder, *a, arrangement="lattice")
        for order, number, tolerance in LATTICE_RUNS}
    measurements[f"five-point loop 1/{intervals}"] = lambda: program.ask(f"five_point {intervals}")
    for title, (seconds, rest) in in_turn(measurements).items():
        note("lattice", title, 0, 2, 0, "seconds", seconds, "s")
        note("lattice", title, 0, 2, 0, "relative L2 error", rest[0], "")
    program.close()


MOTION = """&domain shape = 'disc' radius = 1.0 spacing = {spacing} /
&material conductivity = 0.002 /
&scheme laplacian = '{laplacian}' {order} /
&initial temperature_expression = 'exp(-((x-0.4)^2+y^2)/0.08)' /
&boundary value = 0.0 /
&motion velocity_x_expression = '-y*(1-x^2-y^2)' velocity_y_expression = 'x*(1-x^2-y^2)' /
&time end = 1.0 /
"""


def measure_motion(calor, folder, scale):
    """What moving particles cost: a disc that turns faster inside than outside."""
    for laplacian, order in (("fatehi_manzari", ""), ("consistent", "order = 4")):
        scene = os.path.join(folder, f"motion_{laplacian}.nml")
        with open(scene, "w") as file:
            file.write(MOTION.format(spacing=0.02 / math.sqrt(scale), laplacian=laplacian, order=order))
        shares = {}
        for _ in range(3):
            text = subprocess.run([calor, "run", scene], capture_output=True, text=True,
                                  env=dict(os.environ, OMP_NUM_THREADS="2")).stdout
            steps = re.search(r"^Motion +(\d+) steps", text, re.MULTILINE)
            for name in ("motion", "neighbour lists", "reassembly"):
                share = re.search(rf"of the time of stepping.*\b{name} ([0-9.]+) %", text)
                if share:
                    shares.setdefault(name, []).append(float(share.group(1)))
            made = re.search(r"rows made (\d+) times, lists of neighbours (\d+) times", text)
        title = f"{laplacian} {order.replace('order = ', '')}".strip()
        for name, values in shares.items():
            note("motion", title, 0, 2, 0, name, statistics.median(values), "% of stepping")
        if steps and made:
            note("motion", title, 0, 2, 0, "steps", float(steps.group(1)), "")
            note("motion", title, 0, 2, 0, "rows made", float(made.group(1)), "times")
            note("motion", title, 0, 2, 0, "lists made", float(made.group(2)), "times")


TRYING = "while trying out how many stages are stable"


def resident(process, key):
    """Bytes of a process in memory: VmRSS now, VmHWM at most."""
    with open(f"/proc/{process.pid}/status") as file:
        for line in file:
            if line.startswith(key):
                return 1024 * int(line.split()[1])
    return 0


def measure_memory(calor, folder, intervals):
    """What a run holds in memory while it steps, and at most before: what each particle more takes."""
    sizes = (intervals // 2, intervals)
    held = []
    for number in sizes:
        scene = os.path.join(folder, f"memory_{number}.nml")
        with open(scene, "w") as file:
            file.write(SCENE.format(spacing=1 / number, laplacian="fatehi_manzari", order="",
                                    tolerance="1e-9 method = 'rkl2'"))
        child = subprocess.Popen([calor, "run", scene], stdout=subprocess.PIPE,
                                 stderr=subprocess.DEVNULL, text=True)
        for line in child.stdout:  # the plan, after which steps begin
            if line.startswith("Output"):
                break
        before = resident(child, "VmHWM")
        samples = []
        while child.poll() is None and len(samples) < 30:
            time.sleep(0.1)
            now = resident(child, "VmRSS")
            if now > 0:  # nothing is told of a process that has just ended
                samples.append(now)
        child.kill()  # not terminate: an interrupted run would leave a checkpoint
        child.communicate()
        # The first sample may fall before what steps do not need is freed.
        held.append([statistics.median(samples[1:]), max(samples[1:]), before]
                    if len(samples) > 3 else [math.nan] * 3)
    particles = [(number + 1) ** 2 for number in sizes]
    for place, name in enumerate(("while stepping", TRYING, "at most, in set-up")):
        note("memory", f"calor run, fatehi_manzari, {name}", particles[1], 2, 12.4, name,
             (held[1][place] - held[0][place]) / (particles[1] - particles[0]), "bytes per particle")


# --- What is written ----------------------------------------------------------------------------


def write_csv(path):
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["section", "item", "particles", "threads", "neighbours", "quantity",
                         "value", "unit"])
        for row in table:
            writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in row])


def verdict(reached, wanted):
    """A ratio of what was reached to what was wanted, both the smaller the better."""
    if math.isnan(reached):
        return "not measured"
    return "reached" if reached <= wanted else f"missed by a factor of {reached / wanted:.2f}"


def targets():
    """Targets, each as name, what was wanted, what was reached, verdict."""
    lines = []
    for threads, wanted in ((1, 0.2), (2, 0.11)):
        reached = found("lists", "calor", "seconds", threads=threads)
        peer = found("lists", "cKDTree query_ball_point", "seconds", threads=threads)
        lines.append((f"lists of random points, 20 neighbours, {threads} thread(s)", f"{wanted} s",
                      f"{reached:.3f} s, {peer / reached:.0f} times faster than cKDTree",
                      verdict(reached, wanted)))
    for title, wanted in (("fatehi_manzari", 0.8), ("consistent 4", 5), ("consistent 6", 20),
                          ("consistent 8", 70)):
        for work in ("weights", "rows"):
            reached = found(work, title, "ns per particle", threads=1) / 1000
            lines.append((f"`{title}`, {work}, 1 thread", f"{wanted} µs", f"{reached:.2f} µs",
                          verdict(reached, wanted)))
    for title in ("fatehi_manzari", "consistent 4", "consistent 8"):
        one = found("rows", title, "ns per particle", threads=1)
        two = found("rows", title, "ns per particle", threads=2)
        lines.append((f"`{title}`, rows, 2 threads against 1", "1.8 times", f"{one / two:.2f} times",
                      verdict(1.8, one / two)))
    steps = [row for row in table if row[0] == "steps" and row[3] == 2 and
             row[1].startswith("stage") and row[5] == "ns per particle"]
    for row in steps:
        entries, particles = row[4], row[2]
        kind = " (32-bit weights)" if "32-bit" in row[1] else ""
        product = "product (beside 32-bit weights)" if kind else "product"
        mkl = found("steps", f"{product}, {entries}", "ns per particle", particles, 2)
        triad = found("steps", f"triad{kind}, {entries}", "ns per particle", particles, 2)
        title = f"stage{kind}, {entries}, {particles} particles, 2 threads"
        lines.append((title, "MKL's product alone",
                      f"{row[6]:.2f} ns, MKL {mkl:.2f} ns, {row[6] / mkl:.2f} of it",
                      verdict(row[6], mkl)))
        lines.append((title, "85 % of a triad",
                      f"{100 * triad / row[6]:.0f} %", verdict(0.85, triad / row[6])))
    for name in ("fatehi_manzari", "consistent 4", "stage"):
        slope = exponent(name)
        beside = ""
        if name == "stage":
            beside = f", a triad over the same bytes {exponent(TRIAD):.2f}"
        lines.append((f"growth of {name}", "exponent 1.05", f"{slope:.2f}{beside}",
                      verdict(slope, 1.05)))
    for row in [row for row in table if row[0] == "memory" and row[5] == "while stepping"]:
        wanted = 48 + 12 * row[4]
        trying = found("memory", row[1].replace(row[5], TRYING), TRYING)
        lines.append((f"memory of {row[1]}", f"{wanted:.0f} bytes per particle",
                      f"{row[6]:.0f}, {trying:.0f} {TRYING}", verdict(max(row[6], trying), wanted)))
    for limit, seconds in ((3e-4, 0.01), (1e-6, 0.04), (1e-8, 0.4)):
        best = {"calor": math.inf, "others": math.inf}
        for row in table:
            if row[0] == "runs" and row[5] == "seconds":
                error = found("runs", row[1], "relative L2 error")
                who = "calor" if row[1].startswith("calor") else "others"
                if error <= limit:
                    best[who] = min(best[who], row[6])
        text = "not reached" if math.isinf(best["calor"]) else f"{1000 * best['calor']:.1f} ms"
        if not math.isinf(best["others"]):
            text += f", best peer {1000 * best['others']:.1f} ms"
        lines.append((f"plate to an error of {limit:g}, whole run", f"{1000 * seconds:g} ms", text,
                      verdict(best["calor"], seconds)))
    loop = [row for row in table if row[0] == "lattice" and row[1].startswith("five")
            and row[5] == "seconds"]
    good = [row for row in table if row[0] == "lattice" and row[1].startswith("calor")
            and row[5] == "seconds" and found("lattice", row[1], "relative L2 error") <= 1e-5]
    if loop and good:
        best = min(row[6] for row in good)
        lines.append(("plate on a lattice to an error of 1e-5", "the five-point loop",
                      f"{1000 * best:.1f} ms, the loop {1000 * loop[0][6]:.0f} ms, "
                      f"{best / loop[0][6]:.3f} of it", verdict(best, loop[0][6])))
    return lines


def markdown():
    text = ["![Growth with the number of particles, and time to an error](pictures/speed.png)", "",
            "### Targets", "", "| what | wanted | reached | |", "|---|---|---|---|"]
    text += ["| " + " | ".join(line) + " |" for line in targets()]
    text += ["", "### Set-up, ns per particle", "",
             "| scheme | neighbours | lists, 1 / 2 threads | weights, 1 / 2 threads | "
             "rows with repairs, 1 / 2 threads | per neighbour of the rows |", "|---|---|---|---|---|---|"]
    for name, order, _ in SCHEMES:
        title = f"{name} {order}" if order else name
        cells = []
        for work in ("lists", "weights", "rows"):
            cells.append(" / ".join(f"{found(work, title, 'ns per particle', threads=t):.0f}"
                                    for t in (1, 2)))
        neighbours = [row[4] for row in table if row[:2] == ("rows", title)]
        if not neighbours:
            continue
        each = found("rows", title, "ns per particle", threads=1) / neighbours[0]
        text.append(f"| `{title}` | {neighbours[0]:.1f} | " + " | ".join(cells) + f" | {each:.0f} |")
    text += ["", "### Lists of random points, 20 neighbours", "", "| | points | threads | s |",
             "|---|---|---|---|"]
    text += [f"| {r[1]} | {r[2]} | {r[3]} | {r[6]:.3f} |" for r in table if r[0] == "lists"
             and r[5] == "seconds"]
    text += ["", "### Steps", "", "`stage`: a whole RKL2 stage, product and vector updates in one sweep;"
             " `rate`: a right-hand side; `csr`: the product from compressed rows; `product`: MKL's."
             " The bandwidth counts 12 bytes for a neighbour and the vectors; MKL may move fewer.", "",
             "| | particles | threads | ns per particle | GB/s |", "|---|---|---|---|---|"]
    for row in table:
        if row[0] == "steps" and row[5] == "ns per particle":
            speed = found("steps", row[1], "bandwidth", row[2], row[3])
            speed = "" if math.isnan(speed) else f"{speed:.1f}"
            text.append(f"| {row[1]} | {row[2]} | {row[3]} | {row[6]:.2f} | {speed} |")
    text += ["", "### Growth, 2 threads", "", "| | particles | s | exponent |", "|---|---|---|---|"]
    for row in table:
        if row[0] == "growth":
            text.append(f"| {row[1]} | {row[2]} | {row[6]:.4g} | {exponent(row[1]):.2f} |")
    text += ["", "### The plate to t = 0.05, whole runs", "", "| | relative L2 error | ms |", "|---|---|---|"]
    for row in table:
        if row[0] == "runs" and row[5] == "seconds":
            error = found("runs", row[1], "relative L2 error")
            text.append(f"| {row[1]} | {error:.1e} | {1000 * row[6]:.1f} |")
    text += ["", "### The plate on a lattice, 2 threads", "", "| | relative L2 error | ms |",
             "|---|---|---|"]
    for row in table:
        if row[0] == "lattice" and row[5] == "seconds":
            error = found("lattice", row[1], "relative L2 error")
            text.append(f"| {row[1]} | {error:.1e} | {1000 * row[6]:.1f} |")
    text += ["", "### Weights beside those of RBF-FD, searches included, 1 thread", "",
             "| | neighbours | µs per particle |", "|---|---|---|"]
    text += [f"| {r[1]} | {r[4]} | {r[6] / 1000:.2f} |" for r in table if r[0] == "weights of others"]
    text += ["", "### Moving particles: a disc that turns faster inside than outside", "",
             "| | what | |", "|---|---|---|"]
    text += [f"| {r[1]} | {r[5]} | {r[6]:.3g} {r[7]} |" for r in table if r[0] == "motion"]
    text += ["", "### Memory", "", "| | particles | bytes per particle |", "|---|---|---|"]
    text += [f"| {r[1]} | {r[2]} | {r[6]:.0f} |" for r in table if r[0] == "memory"]
    return "\n".join(text) + "\n"


def draw(folder):
    """Growth and whole runs, by gnuplot."""
    series = {"fatehi_manzari": [], "consistent 4": [], "stage": []}
    for row in table:
        if row[0] == "growth" and row[1] in series:
            series[row[1]].append((row[2], row[6]))
    runs = {"calor": [], "others": []}
    for row in table:
        if row[0] == "runs" and row[5] == "seconds":
            error = found("runs", row[1], "relative L2 error")
            runs["calor" if row[1].startswith("calor") else "others"].append((error, row[6]))
    script = [f"set terminal pngcairo size 1000,420; set output '{folder}/speed.png'",
              "set multiplot layout 1,2; set logscale xy; set format '10^{%T}'; set key left top",
              "set xlabel 'particles'; set ylabel 'seconds, 2 threads'"]
    for number, (name, points) in enumerate(list(series.items()) + list(runs.items())):
        script += [f"$d{number} << EOD"] + [f"{x} {y}" for x, y in points] + ["EOD"]
    script += ["plot " + ", ".join(f"$d{k} with linespoints title '{name}' noenhanced"
                                   for k, name in enumerate(series)),
               "set xlabel 'relative L2 error'; set ylabel 'seconds, whole run'; set key right top",
               "plot " + ", ".join(f"$d{k + len(series)} with points pointsize 1.5 title '{name}'"
                                   for k, name in enumerate(runs)), "unset multiplot"]
    subprocess.run(["gnuplot"], input="\n".join(script) + "\n", text=True, check=False)


def main():
    bench, calor, output = (os.path.abspath(path) for path in sys.argv[1:4])
    os.environ.setdefault("GOMP_SPINCOUNT", "1000")  # as calor itself has it
    scale = float(sys.argv[4]) if len(sys.argv) > 4 else 1.0
    os.makedirs(output, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        parts = {
            "lists": lambda: measure_lists(bench, round(1e6 * scale)),
            "schemes": lambda: measure_schemes(bench, round(4e4 * scale)),
            "weights of others": lambda: measure_peer_weights(bench, round(1e4 * scale), folder),
            "steps": lambda: measure_steps(bench, [round(1e6 * scale), round(4e6 * scale)]),
            "growth": lambda: measure_growth(
                bench, [max(1000, round(n * scale)) for n in (1e4, 1e5, 1e6, 4e6)]),
            "runs": lambda: measure_runs(bench, calor, folder),
            "lattice": lambda: measure_lattice(bench, calor, folder, scale),
            "motion": lambda: measure_motion(calor, folder, scale),
            "memory": lambda: measure_memory(calor, folder, intervals_for(2.5e5 * scale)),
        }
        failed = []
        for name, part in parts.items():
            begin = time.perf_counter()
            try:
                part()
            except Exception:  # what else can be measured is
                traceback.print_exc()
                failed.append(name)
            print(f"bench: {name} took {time.perf_counter() - begin:.0f} s", flush=True)
            write_csv(os.path.join(output, "speed.csv"))
    with open(os.path.join(output, "speed.md"), "w") as file:
        file.write(markdown())
    draw(output)
    if failed:
        sys.exit("bench: failed: " + ", ".join(failed))


if __name__ == "__main__":
    main()
