#!/usr/bin/env python3
"""Feed damaged scenes and clouds to calor and see that it bears them.

    tools/fuzz.py CHECKED RELEASE [--count N] [--seconds S] [--seed K] [--keep FOLDER]

CHECKED is a build of calor with sanitizers and run-time checks, which finds most; RELEASE, an
ordinary one, tells whether what takes long there is too slow. Every case takes a scene of data/,
damages it (values, types, keys, groups, bytes, encodings, sizes, or the cloud it reads, CSV or
HDF5) and runs `calor check` on it; what passes and is small is run as well, and some damaged HDF5
files are given to `calor plot`. A case fails where calor

  - ends with a status other than 0 (done), 2 (wrong input), 3 (the numbers went wrong) or 4 (a file),
  - complains in more than five lines, or says nothing when it fails,
  - shows a backtrace, or a finding of a sanitizer or of a run-time check,
  - takes more than ten seconds of the processor in the ordinary build, or does not end,
  - changes one of its input files, or, after wrong input, an output file that was there before.

Failing cases are kept in FOLDER (build/fuzz), each with the command and what it said. The last line
is "N cases, M failed"; the exit status is 1 if any failed. The same seed makes the same cases.
"""

import argparse
import concurrent.futures
import os
import pathlib
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
MOST_SECONDS = 10  # of the processor, in the ordinary build
CHECKED_SECONDS = 60  # where sanitizers slow things down
PATIENCE = 300.0  # seconds, on a busy machine
MOST_LINES = 5
GOOD_STATUS = {0, 2, 3, 4}
# malloc refuses what is too large, as it does without a sanitizer; HDF5 knows how to bear it.
SANITIZER = "detect_leaks=0:allocator_may_return_null=1"
REFUSAL = re.compile(r"^==\d+==WARNING: AddressSanitizer failed to allocate .*\n?", re.M)
FINDINGS = re.compile(
    r"Backtrace|ERROR: AddressSanitizer|runtime error|Fortran runtime|SIG[A-Z]{3,4}:|"
    r"Segmentation fault|Floating point exception|terminate called|forrtl"
)

# Values that programs trip over
NASTY = """0 -1 1 0.0 -0.0 1e29 -1e29 1e-29 1e30 1e31 1e308 -1e308 1e400 1e-308 1e-400 4.9e-324 nan inf -inf .true. .false. T F
'' ' ' 'x' "" "'" 99999999999999999999 2147483648 -2147483649 1.0.0 1e 1d5 1q3 0x10 1_8 (1,2) 3*1 3*
/ & , = ! ' " $ % ; é \t \\ ../../../../etc/passwd /dev/null /dev/full /dev/zero . .. /
'1/0' 'sqrt(-1)' 'x/0*0' 't^1e9' 'exp(exp(exp(10)))' '((((' ')' 'sin' 'sin(' 'sin()' 'x y' '1 ? 2'
'1 ? 2 :' 'a=1' 'pi=3' 'x=2' 'T' 't' 'nosuch(x)' '1e999' 'min()' 'sum(x,y,t)' 'rnd' '$' '"'""".split()
SPACING_FACTORS = [0.7, 1.5, 2.0, 3.0, 10.0, 1e3, 1e9, 1e20, 1e29, 1e-9, 1e-29, 1e-200, 0.0, -1.0]


def scenes():
    """The text of every scene of data/, by path."""
    found = {}
    for path in sorted((ROOT / "data").rglob("*.nml")):
        found[path] = path.read_text(encoding="utf-8")
    return found


def groups_of(text):
    """Spans of the groups of a scene."""
    return [m.span() for m in re.finditer(r"^&\w+(?:'[^'\n]*'|\"[^\"\n]*\"|[^/'\"])*/[^\n]*\n?", text, re.M)]


def change_value(text, chance):
    """Another value for some key; spacings only become what is quick or absurd."""
    values = list(re.finditer(r"(\w+)\s*=\s*('[^'\n]*'|\"[^\"\n]*\"|[^\s/=]+)", text))
    if not values:
        return text
    match = chance.choice(values)
    old = match.group(2)
    if match.group(1).lower() == "spacing":
        try:
            new = repr(float(old) * chance.choice(SPACING_FACTORS))
        except ValueError:
            new = chance.choice(NASTY)
    else:
        kind = chance.randrange(4)
        if kind == 0:
            new = chance.choice(NASTY)
        elif kind == 1:
            new = chance.choice(values).group(2)
        elif kind == 2:
            new = ", ".join([old] * chance.choice([2, 3, 17]))
        else:
            try:
                new = repr(float(old) * chance.choice([-1, 0, 0.1, 10, 1e6, 1e-6, 1e12, 1e-12, 1e20, 1e-20, 1e300]))
            except ValueError:
                cut = chance.randrange(len(old) + 1)
                new = old[:cut] + chance.choice(["", "(", ")", "*", "1", "'", "é", "^", "?"]) + old[cut:]
    return text[: match.start(2)] + new + text[match.end(2):]


def change_key(text, chance):
    keys = list(re.finditer(r"(\w+)(\s*=)", text))
    if not keys:
        return text
    match = chance.choice(keys)
    old = match.group(1)
    new = chance.choice(
        [old[:-1], old + "x", old.upper(), old + "_expression", "", chance.choice(keys).group(1), "a" * 300, old + "(2)"]
    )
    return text[: match.start(1)] + new + text[match.end(1):]


def change_groups(text, chance):
    spans = groups_of(text)
    if not spans:
        return text
    start, end = chance.choice(spans)
    kind = chance.randrange(5)
    if kind == 0:  # left out
        return text[:start] + text[end:]
    if kind == 1:  # twice, or very often
        return text[:end] + "\n" + text[start:end] * chance.choice([1, 2, 50]) + text[end:]
    if kind == 2:  # another name
        name = chance.choice(["domain", "time", "material", "boundary", "nosuch", "", "output", "accuracy", "source"])
        return text[:start] + re.sub(r"^&\w+", "&" + name, text[start:end]) + text[end:]
    if kind == 3:  # not closed
        return text[:start] + text[start:end].replace("/", "", 1) + text[end:]
    other = chance.choice(spans)  # moved
    return text[: other[0]] + text[start:end] + text[other[0]:]


def add_group(text, chance):
    """A group that calls for something more."""
    return text + "\n" + chance.choice([
        "&accuracy estimate = .true. /", "&accuracy target = 1e-2 /", "&source power = 1e5 /",
        "&source power_expression = 'T*T' /", "&boundary on = 'all' kind = 'insulated' /",
        "&boundary on = 'all' kind = 'radiation' emissivity = 0.5 ambient = 1 /",
        "&boundary on = 'left' kind = 'convection' coefficient = 1e3 ambient_expression = 't' /",
        "&boundary on = 'all' kind = 'flux' value_expression = 'x*t' /",
        "&material latent_heat = 1e3 solidus = 0.1 liquidus = 0.2 /",
        "&material conductivity = 10 where_expression = 'x > 0.5' /",
        "&scheme laplacian = 'consistent' order = 4 /", "&scheme laplacian = 'positive' /",
        "&scheme laplacian = 'brookshaw' /", "&scheme laplacian = 'double_gradient' /",
        "&kernel name = 'quintic_spline' support = 1.01 /", "&kernel support = 9 /",
        "&motion velocity_x_expression = '-y' velocity_y_expression = 'x' /",
        "&checkpoint file = 'c.h5' every_seconds = 1e-3 /",
        "&operators field_expression = 'x*y' gradients = 'all' laplacians = 'all' /",
        "&time steady = .true. /", "&output file = 'kept.vtkhdf' every = 1e-3 /",
    ]) + "\n"


def change_bytes(data, chance):
    data = bytearray(data)
    kind = chance.randrange(8)
    if kind == 0 and data:  # some bits
        for _ in range(chance.choice([1, 3, 30])):
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    elif kind == 1:  # cut off
        data = data[: chance.randrange(len(data) + 1)]
    elif kind == 2:  # a zero, a control character, half of a UTF-8 character
        at = chance.randrange(len(data) + 1)
        data[at:at] = chance.choice([b"\0", b"\x1b[2J", b"\xc3", b"\xff\xfe", b"\x7f", b"\r", b"\x0c"])
    elif kind == 3:  # other encodings
        text = bytes(data).decode("utf-8", "replace")
        encoding = chance.choice(["utf-16", "utf-8-sig", "latin-1", "utf-32"])
        data = bytearray(text.encode(encoding, "replace"))
    elif kind == 4:  # other ends of lines
        data = bytearray(bytes(data).replace(b"\n", chance.choice([b"\r\n", b"\r", b"\n\n", b""])))
    elif kind == 5:  # noise
        data = bytearray(chance.randbytes(chance.choice([0, 1, 100, 10000])))
    elif kind == 6:  # a very long line
        at = chance.randrange(len(data) + 1)
        data[at:at] = chance.choice([b" ", b"1, ", b"(", b"x+", b"'", b"!"]) * chance.choice([1000, 100000])
    else:  # a part twice, elsewhere
        a, b = sorted(chance.randrange(len(data) + 1) for _ in range(2))
        at = chance.randrange(len(data) + 1)
        data[at:at] = data[a:b]
    return bytes(data)


def change_hdf5(data, chance):
    """A number in it becomes one that programs trip over; or any other damage to its bytes."""
    if chance.random() < 0.5:
        return change_bytes(data, chance)
    data = bytearray(data)
    for _ in range(chance.choice([1, 1, 3, 20])):
        at = 8 * chance.randrange(len(data) // 8)
        data[at : at + 8] = chance.choice(
            [struct.pack("<d", value) for value in (0.0, -1.0, 1e300, 1e29, 1e-300, float("nan"), float("inf"))]
            + [struct.pack("<q", value) for value in (0, 1, 2, -1, 2**31, 2**40, 2**62)]
        )
    return bytes(data)


def damage_scene(text, chance):
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        step = chance.choice([change_value] * 5 + [change_key] * 2 + [change_groups, add_group])
        text = step(text, chance)
    data = text.encode("utf-8", "replace")
    if chance.random() < 0.2:
        data = change_bytes(data, chance)
    return data


def damage_csv(data, chance):
    lines = data.decode("utf-8").split("\n")
    at = chance.randrange(len(lines))
    cells = lines[at].split(",")
    kind = chance.randrange(5)
    if kind == 0:
        cells[chance.randrange(len(cells))] = chance.choice(NASTY)
    elif kind == 1:
        cells.append("1")
    elif kind == 2:
        cells.pop()
    elif kind == 3:
        lines[at:at] = [lines[at]] * chance.choice([1, 1000])
    else:
        return change_bytes(data, chance)
    lines[at] = ",".join(cells)
    return "\n".join(lines).encode("utf-8", "replace")


class Fuzz:
    def __init__(self, checked, release, seed, keep):
        self.checked = pathlib.Path(checked).resolve()
        self.release = pathlib.Path(release).resolve()
        self.seed = seed
        self.keep = keep
        self.scenes = list(scenes().items())
        self.environment = dict(os.environ, ASAN_OPTIONS=SANITIZER, OMP_NUM_THREADS="1", LC_ALL="C")
        self.stock = pathlib.Path(tempfile.mkdtemp(prefix="fuzz-"))
        # A cloud as calor writes it, to be read again
        scene = self.stock / "small.nml"
        scene.write_text(
            "&domain x_range = 0, 1 y_range = 0, 1 spacing = 0.2 /\n&time end = 0.01 /\n"
            "&initial temperature_expression = 'x' /\n&boundary value = 0 /\n&output file = 'small.vtkhdf' /\n"
        )
        self.call(["run", "small.nml"], self.stock)
        self.cloud = (self.stock / "small.vtkhdf").read_bytes()

    def call(self, arguments, folder):
        """Status and what was said; status None: too long."""
        outcome = self.call_build(self.checked, CHECKED_SECONDS, arguments, folder)
        if outcome[0] is None:
            outcome = self.call_build(self.release, MOST_SECONDS, arguments, folder)
        return outcome

    def call_build(self, calor, seconds, arguments, folder):
        try:
            done = subprocess.run(
                ["prlimit", f"--cpu={seconds}", calor, *arguments], cwd=folder, env=self.environment, stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=PATIENCE,
            )
            status, out, err = done.returncode, done.stdout, done.stderr
            if status in (-signal.SIGXCPU, -signal.SIGKILL):
                status = None
        except subprocess.TimeoutExpired as late:
            status, out, err = None, late.stdout or b"", late.stderr or b""
        return status, out.decode("utf-8", "replace"), REFUSAL.sub("", err.decode("utf-8", "replace"))

    def judge(self, status, out, err):
        """What is wrong with an outcome; '' if nothing."""
        if status is None:
            return f"took more than {MOST_SECONDS} s"
        if status not in GOOD_STATUS:
            return f"status {status}"
        if FINDINGS.search(out) or FINDINGS.search(err):
            return "a backtrace or a finding of a sanitizer"
        lines = [line for line in err.split("\n") if line.strip()]
        if status != 0 and not lines:
            return "failed without a word"
        if status != 0 and len(lines) > MOST_LINES:
            return f"complained in {len(lines)} lines"
        return ""

    def case(self, number):
        """Make and try case `number`: None if it is well, else what went wrong."""
        chance = random.Random(f"{self.seed}/{number}")
        folder = self.stock / str(number)
        folder.mkdir()
        try:
            path, text = chance.choice(self.scenes)
            files = {}
            cloud = re.search(r"file\s*=\s*'([^']+\.csv)'", text)
            if cloud and (path.parent / cloud.group(1)).exists():
                files[cloud.group(1)] = (path.parent / cloud.group(1)).read_bytes()
            kind = chance.random()
            if kind < 0.08:
                files["cloud.vtkhdf"] = change_hdf5(self.cloud, chance)
                text = "&domain shape = 'cloud' file = 'cloud.vtkhdf' spacing = 0.2 /\n&boundary value = 0 /\n&time end = 0.01 /\n"
                scene = text.encode()
            elif files and kind < 0.5:
                name = next(iter(files))
                files[name] = damage_csv(files[name], chance)
                scene = text.encode()
            else:
                scene = damage_scene(text, chance)
            files["scene.nml"] = scene
            files["kept.vtkhdf"] = b"what was there before"
            for name, data in files.items():
                (folder / name).write_bytes(data)
            arguments = ["check", "scene.nml"]
            status, out, err = self.call(arguments, folder)
            wrong = self.judge(status, out, err)
            if not wrong and "cloud.vtkhdf" in files and chance.random() < 0.2:
                arguments = ["plot", "cloud.vtkhdf"]
                status, out, err = self.call(arguments, folder)
                wrong = self.judge(status, out, err)
            elif not wrong and status == 0 and self.is_small(out):
                arguments = ["run", "scene.nml"]
                status, out, err = self.call(arguments, folder)
                wrong = self.judge(status, out, err)
            for name, data in files.items():
                if wrong or (name == "kept.vtkhdf" and status == 0):
                    continue
                # After numbers that went wrong the last good state is written.
                if name == "kept.vtkhdf" and status == 3:
                    continue
                if not (folder / name).exists() or (folder / name).read_bytes() != data:
                    wrong = f"changed {name}"
            if not wrong:
                return None
            self.save(number, folder, arguments, wrong, out, err)
            return wrong
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    @staticmethod
    def is_small(out):
        """Whether what `check` said promises a run of a moment."""
        particles = re.search(r"^Particles\s+(\d+)", out, re.M)
        steps = re.search(r"about ([0-9.e+]+) steps", out)
        if not particles or int(particles.group(1)) > 2000:
            return False
        return bool(steps) and float(steps.group(1)) * int(particles.group(1)) < 1e5 or "steady" in out

    def save(self, number, folder, arguments, wrong, out, err):
        place = self.keep / f"{self.seed}-{number}"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(folder, place)
        (place / "outcome.txt").write_text(
            f"{wrong}\ncalor {' '.join(arguments)}\n--- said\n{out[-4000:]}\n--- complained\n{err[-8000:]}\n"
        )


def main():
    parser = argparse.ArgumentParser(description="Feed damaged scenes and clouds to calor.")
    parser.add_argument("checked")
    parser.add_argument("release")
    parser.add_argument("--count", type=int, default=20000)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=pathlib.Path, default=ROOT / "build" / "fuzz")
    options = parser.parse_args()
    fuzz = Fuzz(options.checked, options.release, options.seed, options.keep)
    end = time.monotonic() + options.seconds
    failures, done = 0, 0
    try:
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            waiting = set()
            numbers = iter(range(1, options.count + 1))
            more = True
            while more or waiting:
                while more and len(waiting) < 2 * os.cpu_count():
                    number = next(numbers, None)
                    more = number is not None and time.monotonic() < end
                    if more:
                        waiting.add(pool.submit(lambda k: (k, fuzz.case(k)), number))
                if not waiting:
                    break
                ready, waiting = concurrent.futures.wait(waiting, return_when=concurrent.futures.FIRST_COMPLETED)
                for case in ready:
                    number, wrong = case.result()
                    done += 1
                    if wrong:
                        failures += 1
                        print(f"case {number}: {wrong} ({options.keep}/{options.seed}-{number})", flush=True)
    finally:
        shutil.rmtree(fuzz.stock, ignore_errors=True)
    print(f"{done} cases, {failures} failed")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
