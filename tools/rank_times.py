#!/usr/bin/env python3
"""Times ranks of calor-mpi against each other and against calor, weighs their memory, and predicts larger runs.

    tools/rank_times.py BIN DOCUMENT [--repeats 7] [--spacing 0.004]

BIN is the folder of calor and calor-mpi. The commands take turns; medians of the phase 'steps' are compared.
The tables take the place of those in DOCUMENT, docs/scaling.md, that stand after <!-- memory -->, <!-- times -->
and <!-- prediction -->.
"""

import argparse
import math
import os
import re
import statistics
import subprocess
import tempfile

SCENE = """&domain shape = 'rectangle' x_range = 0, 1 y_range = 0, 1 spacing = {spacing}
  arrangement = 'jittered' jitter = 0.2 /
&initial temperature_expression = 'sin(pi*x)*sin(pi*y)' /
&boundary on = 'all' kind = 'temperature' value = 0 /
&kernel support = 2.1 /
&time end = 0.02 method = 'rkl2' tolerance = 1e-8 /
"""
# What is assumed of a network: seconds to a message, bytes in a second to a core
LATENCY, BANDWIDTH = 2e-6, 0.2e9
# A region has about so many neighbours; a step adds up over all ranks so many times
NEIGHBOURS, SUMS = 8, 6
# Bytes for a particle, and of a rank whatever it has; bytes sent over 8 sqrt(N/P) h/dx (all measured)
PARTICLE_BYTES, RANK_BYTES, BORDER, SUPPORT = 1000, 45e6, 4.4, 2.1


def run(command, folder, threads):
    """Wall time of the steps, how many there were, and products with the Laplacian."""
    said = subprocess.run(command, cwd=folder, check=True, text=True, stdout=subprocess.PIPE,
                          env={**os.environ, "OMP_NUM_THREADS": str(threads)}).stdout
    steps, products = map(int, re.search(r"^Steps +(\d+) steps.* (\d+) evaluations", said, re.M).groups())
    return float(re.search(r"^  steps +([\d.eE+-]+) s", said, re.M).group(1)), steps, products


def size(number):
    return f"{number / 1e9:.2g} GB" if number >= 1e9 else f"{number / 1e6:.0f} MB"


def weigh(command, folder, spacing):
    """Peak of a rank, bytes, and particles that it has, its own and others'."""
    with open(f"{folder}/weigh.nml", "w", encoding="utf-8") as file:
        file.write(SCENE.format(spacing=spacing))
    said = subprocess.run([*command, "check", "weigh.nml"], cwd=folder, check=True, text=True,
                          stdout=subprocess.PIPE, env={**os.environ, "OMP_NUM_THREADS": "1"}).stdout
    own, others = map(int, re.search(r"^Ranks .* to (\d+) particles and at most (\d+)", said, re.M).groups())
    return 1024*int(re.search(r"^Taken +(\d+)", said, re.M).group(1)), own + others


def memory(mpirun, program, folder):
    """A table of peaks, and of what each further particle takes."""
    rows = ["| ranks | peak of a rank, kB | further bytes for each further particle, its own or within reach |",
            "|---|---|---|"]
    for ranks in (1, 2, 4, 8):
        command = [*mpirun, "-n", str(ranks), program]
        (little, few), (much, many) = weigh(command, folder, "0.02"), weigh(command, folder, "0.004")
        rows.append(f"| {ranks} | {much // 1024} | {(much - little)/(many - few):.0f} |")
    return rows


def put(document, mark, rows):
    """Put a table, or a line, in place of what follows a mark up to the next empty line but one."""
    with open(document, encoding="utf-8") as file:
        text = file.read()
    head, rest = text.split(f"<!-- {mark} -->\n\n", 1)
    rest = rest[rest.index("\n\n"):]
    with open(document, "w", encoding="utf-8") as file:
        file.write(f"{head}<!-- {mark} -->\n\n" + "\n".join(rows) + rest)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bin")
    parser.add_argument("document")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--spacing", default="0.004")
    given = parser.parse_args()
    programs = os.path.abspath(given.bin)
    mpirun = ["mpirun", "--oversubscribe"] + ["--allow-run-as-root"]*(os.getuid() == 0)
    ways = {f"`calor`, {k} thread{'s'[:k - 1]}": ([f"{programs}/calor"], k) for k in (1, 2)}
    ways |= {f"{k} rank{'s'[:k - 1]}": (mpirun + ["-n", str(k), f"{programs}/calor-mpi"], 1) for k in (1, 2)}
    times = {way: [] for way in ways}
    with tempfile.TemporaryDirectory() as folder:
        with open(f"{folder}/plate.nml", "w", encoding="utf-8") as file:
            file.write(SCENE.format(spacing=given.spacing))
        for _ in range(given.repeats):
            for way, (command, threads) in ways.items():
                seconds, steps, products = run([*command, "run", "plate.nml"], folder, threads)
                times[way].append(seconds)
        put(given.document, "memory", memory(mpirun, f"{programs}/calor-mpi", folder))
    median = {way: statistics.median(values) for way, values in times.items()}
    rows = ["| | steps, s (median) | over 1 rank |", "|---|---|---|"]
    rows += [f"| {way} | {seconds:.3g} | {seconds / median['1 rank']:.2f} |" for way, seconds in median.items()]
    put(given.document, "times", rows)
    particles = (round(1/float(given.spacing)) + 1)**2
    of_particle = 2*median["2 ranks"]/products/particles
    stages = products/steps
    rows = [f"With two ranks at work a product takes {of_particle*1e9:.3g} ns a particle on each core, and a step of "
            f"this run {stages:.2g} products."]
    put(given.document, "product", rows)
    rows = ["| particles | cores | a step, s | of it for other ranks | memory of a rank |", "|---|---|---|---|---|"]
    for total in (1e7, 1e8, 1e9):
        for cores in (16, 64, 256, 1024, 4096):
            share = total/cores
            work = stages*share*of_particle
            border = BORDER*8*math.sqrt(share)*SUPPORT
            talk = stages*(NEIGHBOURS*LATENCY + border/BANDWIDTH) + SUMS*2*math.log2(cores)*LATENCY
            halo = border/8 + 400
            rows.append(f"| 10{'⁷⁸⁹'[round(math.log10(total)) - 7]} | {cores} | {work + talk:.2g} | "
                        f"{100*talk/(work + talk):.1f} % | {size(RANK_BYTES + PARTICLE_BYTES*(share + halo))} |")
    put(given.document, "prediction", rows)


if __name__ == "__main__":
    main()
