#!/usr/bin/env python3
"""An hour of users who come and go, light and objects that move, updates, scenes that are loaded again.

    tests/bench/soak.py --out DIR [--minutes 60] [--users 200] [--scene builtin:atrium-matt] [--density 2]

Writes DIR/soak.csv, DIR/soak.json and DIR/soak.svg (gnuplot), and prints what soak.json holds. Wanted: resident
memory grows by less than 1 MB an hour after the first 10 minutes, descriptors do not, no frame takes over a
second, and the light of every sampled client is that of a client which has just come. Wants the programs of
build/release/bin, or of --bin."""
import argparse
import json
import os
import pathlib
import random
import re
import shutil
import signal
import subprocess
import threading
import time
import urllib.request

TICK_S = 5        # a row of the CSV
CHANGE_S = 3      # between two updates
WARM_S = 600      # that do not count for the slope
SAMPLED = 4       # clients that stay


def parse():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--out", required=True, type=pathlib.Path)
    p.add_argument("--minutes", type=float, default=60)
    p.add_argument("--users", type=int, default=200)
    p.add_argument("--scene", default="builtin:atrium-matt")
    p.add_argument("--density", type=float, default=2, help="texels per metre of the first scene")
    p.add_argument("--frame-rate", type=float, default=10)
    p.add_argument("--compare-s", type=float, default=300, help="between two comparisons of light")
    p.add_argument("--reload-s", type=float, default=600, help="between two scenes")
    p.add_argument("--bin", type=pathlib.Path,
                   default=pathlib.Path(__file__).resolve().parents[2] / "build/release/bin")
    return p.parse_args()


class Soak:
    def __init__(self, a):
        self.a = a
        self.stop = threading.Event()
        self.paused = threading.Event()
        self.reloading = threading.Event()
        self.lock = threading.Lock()
        self.longest_ms = self.longest_ever_ms = 0.0
        self.frames = self.changes = self.refused = self.reloads = 0
        self.loads, self.faults, self.rows, self.verdicts = [], [], [], []

    def start(self):
        a = self.a
        for name in ("lightwelld", "lightwellctl", "lightwell-import", "lightwell-load", "bench_soak"):
            if not (a.bin / name).exists():
                raise SystemExit(f"soak: {a.bin / name} is missing: scripts/build.sh release, or --bin")
        a.out.mkdir(parents=True, exist_ok=True)
        for name, density in (("a", a.density), ("b", a.density * 1.1)):
            subprocess.run([a.bin / "lightwell-import", a.scene, "-o", a.out / f"{name}.lwscene",
                            "--texels-per-metre", str(density)], check=True, stderr=subprocess.DEVNULL)
        shutil.copy(a.out / "a.lwscene", a.out / "scene.lwscene")
        (a.out / "soak.conf").write_text(f"scene = {a.out}/scene.lwscene\n")
        self.log = open(a.out / "lightwelld.log", "w")
        self.daemon = subprocess.Popen(
            [a.bin / "lightwelld", "--config", a.out / "soak.conf", "--listen", "127.0.0.1:0", "--port-file",
             a.out / "port", "--http", "none", "--metrics", "127.0.0.1:0", "--metrics-port-file",
             a.out / "metrics", "--control-socket", a.out / "control.sock", "--animate", "--frame-rate",
             str(a.frame_rate), "--json", "--error", "0.05"],
            stdout=subprocess.PIPE, stderr=self.log, text=True)
        end = time.time() + 120
        while not (a.out / "port").exists() or not (a.out / "metrics").exists():
            if self.daemon.poll() is not None or time.time() > end:
                raise SystemExit("soak: lightwelld does not serve: see lightwelld.log")
            time.sleep(0.1)
        self.port = int((a.out / "port").read_text())
        self.metrics = int((a.out / "metrics").read_text())

    def read_frames(self):
        for line in self.daemon.stdout:
            try:
                frame = json.loads(line)
            except ValueError:
                continue
            with self.lock:
                self.frames += 1
                self.longest_ms = max(self.longest_ms, frame.get("frame_ms", 0))

    def load(self):
        """Users until a reload ends them; then again."""
        a, n = self.a, 0
        while not self.stop.is_set():
            n += 1
            self.run = subprocess.Popen(
                [a.bin / "lightwell-load", f"127.0.0.1:{self.port}", "--users", str(a.users), "--seconds", "100000",
                 "--ramp", "20", "--churn", str(a.users / 100), "--reconnect", "--path", "walk", "--seed", str(n),
                 "--max-errors", "1000000", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            out, err = self.run.communicate()
            try:
                report = json.loads(out)
                self.loads.append({k: report.get(k) for k in ("end", "measured_s", "tiles", "frames", "errors")})
            except ValueError:
                self.faults.append(f"lightwell-load: {err.strip()[-300:]}")
            self.stop.wait(1)

    def ctl(self, *words):
        r = subprocess.run([self.a.bin / "lightwellctl", f"unix:{self.a.out}/control.sock", *words, "--timeout", "60"],
                           capture_output=True, text=True)
        if r.returncode and not self.reloading.is_set():
            self.refused += 1
            if self.refused < 20:
                self.faults.append(f"lightwellctl {' '.join(words)}: {r.stderr.strip()[-200:]}")
        return r.stdout

    def change(self):
        rng = random.Random(1)
        while not self.stop.wait(CHANGE_S):
            if self.paused.is_set() or self.reloading.is_set():
                continue
            listed = self.listing
            if listed["lights"] and rng.random() < 0.5:
                self.ctl("light", f"#{rng.randrange(listed['lights'])}", rng.choice(("on", "off", "restore")))
            else:
                name = f"#{rng.randrange(listed['objects'])}"
                self.ctl(*rng.choice((("shift", name, "0.05", "0", "0"), ("turn", name, "y", "5"),
                                      ("restore", name))))
            self.changes += 1

    def list(self):
        text = json.loads(self.ctl("list", "--json") or "{}")
        self.listing = {k: len(text.get(k, [])) for k in ("objects", "lights")}

    def figures(self):
        status = pathlib.Path(f"/proc/{self.daemon.pid}/status").read_text()
        kb = int(re.search(r"VmRSS:\s+(\d+)", status)[1])
        descriptors = len(os.listdir(f"/proc/{self.daemon.pid}/fd"))
        text = urllib.request.urlopen(f"http://127.0.0.1:{self.metrics}/metrics", timeout=30).read().decode()
        sessions = re.search(r"^lightwell_sessions (\S+)", text, re.M)
        return kb, descriptors, int(float(sessions[1])) if sessions else -1

    def compare(self):
        self.paused.set()
        self.ctl("clock", "pause")
        self.watch.stdin.write("compare\n")
        self.watch.stdin.flush()
        verdict = json.loads(self.watch.stdout.readline() or "{}")
        self.verdicts.append(verdict)
        self.ctl("clock", "play")
        self.paused.clear()
        return verdict

    def reload(self):
        self.reloading.set()
        which = "b" if self.reloads % 2 == 0 else "a"
        shutil.copy(self.a.out / f"{which}.lwscene", self.a.out / "next.lwscene")
        os.replace(self.a.out / "next.lwscene", self.a.out / "scene.lwscene")
        self.daemon.send_signal(signal.SIGHUP)
        self.reloads += 1
        self.stop.wait(30)
        self.reloading.clear()
        self.list()

    def soak(self):
        a = self.a
        self.start()
        self.list()
        self.watch = subprocess.Popen([a.bin / "bench_soak", f"127.0.0.1:{self.port}", str(SAMPLED)],
                                      stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for work in (self.read_frames, self.load, self.change):
            threading.Thread(target=work, daemon=True).start()
        began, compared, reloaded = time.time(), time.time(), time.time()
        csv = open(a.out / "soak.csv", "w")
        csv.write("s,rss_kb,descriptors,sessions,longest_frame_ms,frames,changes,reloads,tiles_over\n")
        beside = None
        while time.time() - began < 60 * a.minutes:
            time.sleep(TICK_S)
            if self.daemon.poll() is not None:
                self.faults.append(f"lightwelld ended with {self.daemon.returncode}")
                break
            now = time.time()
            if beside is None or not beside.is_alive():
                if now - reloaded > a.reload_s:
                    reloaded, beside = now, threading.Thread(target=self.reload, daemon=True)
                    beside.start()
                elif now - compared > a.compare_s:
                    compared, beside = now, threading.Thread(target=self.compare, daemon=True)
                    beside.start()
            try:
                kb, descriptors, sessions = self.figures()
            except OSError as e:
                self.faults.append(f"figures: {e}")
                continue
            with self.lock:
                longest, self.longest_ms = self.longest_ms, 0.0
                self.longest_ever_ms = max(self.longest_ever_ms, longest)
            over = self.verdicts[-1].get("over", 0) if self.verdicts else 0
            row = (round(now - began, 1), kb, descriptors, sessions, longest, self.frames, self.changes,
                   self.reloads, over)
            self.rows.append(row)
            csv.write(",".join(map(str, row)) + "\n")
            csv.flush()
        if beside and self.daemon.poll() is None:
            beside.join(150)
        self.finish()

    def finish(self):
        self.stop.set()
        for child, how in ((self.run, signal.SIGINT), (self.watch, signal.SIGTERM), (self.daemon, signal.SIGTERM)):
            if child.poll() is None:
                child.send_signal(how)
        try:
            code = self.daemon.wait(30)
        except subprocess.TimeoutExpired:
            self.daemon.kill()
            code = "killed after 30 s"
        late = [r for r in self.rows if r[0] >= min(WARM_S, 30 * self.a.minutes)]
        result = {
            "minutes": round(self.rows[-1][0] / 60, 1) if self.rows else 0, "users": self.a.users,
            "scene": self.a.scene, "lightwelld_exit": code, "frames": self.frames, "changes": self.changes,
            "reloads": self.reloads, "refused_changes": self.refused, "rss_slope_mb_per_h": slope(late),
            "rss_mb_first_last_most": [round(x / 1024, 1) for x in (late[0][1], late[-1][1], max(
                r[1] for r in self.rows))] if late else None,
            "descriptors_least_most": [min(r[2] for r in late), max(r[2] for r in late)] if late else None,
            "longest_frame_ms": self.longest_ever_ms,
            "frames_over_a_second_rows": sum(r[4] > 1000 for r in self.rows),
            "comparisons": self.verdicts, "loads": self.loads, "faults": self.faults}
        (self.a.out / "soak.json").write_text(json.dumps(result, indent=1) + "\n")
        print(json.dumps(result, indent=1))
        plot = pathlib.Path(__file__).with_name("soak.gnuplot")
        subprocess.run(["gnuplot", "-e", f"csv='{self.a.out}/soak.csv'; svg='{self.a.out}/soak.svg'", plot],
                       check=False)


def slope(rows):
    """MB an hour, by least squares."""
    if len(rows) < 3:
        return None
    n, xs, ys = len(rows), [r[0] / 3600 for r in rows], [r[1] / 1024 for r in rows]
    mx, my = sum(xs) / n, sum(ys) / n
    return round(sum((x - mx) * (y - my) for x, y in zip(xs, ys)) / sum((x - mx) ** 2 for x in xs), 2)


Soak(parse()).soak()
