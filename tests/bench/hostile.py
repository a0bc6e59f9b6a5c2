#!/usr/bin/env python3
"""hostile.py: what honest users feel of hostile ones, as a table in Markdown.

Starts lightwelld with a scene whose solver never rests, with all threads that it takes by default: once plain,
once with TLS. Beside it lightwell-load is the honest users and bench_hostile the others, with each kind in turn:
opened, reopened and flooding all the time that is measured. What is told is the users' ping, from PING to PONG,
and the age of their light. "finer" sends no flood, but a list of 1,024 tiles of finer levels a second.

The hostile ones come from 127.0.0.2: an address of its own, with the limits of the own machine, which are wider
than those of others. bench_hostile runs at the nice level --nice, 0 by default: as much of a core as the
server's network thread. At 19 the solver and other programs would leave it little, and it would
look harmless. The columns behind the times say what it did: megabytes written, connections closed by the server,
processor time over time; and how much of a core the server's network thread took, of how much in all.
"""
import argparse, json, os, re, subprocess, sys, tempfile, time, urllib.request

BIN = os.environ.get("LW_BIN", os.path.join(os.path.dirname(__file__), "../../build/release/bin"))
PLAIN = ("ping interest finer everything ack update connect hello half-hello empty-frames ping-frames fragments "
         "get "
         "not-modified get-once half-request").split()
BY_TLS = "records handshakes half-handshake web-handshakes".split()
WEB = "empty-frames ping-frames fragments get not-modified get-once half-request web-handshakes".split()


def program(name):
    return os.path.join(BIN, name)


def make_certificate(folder):
    key, certificate = folder + "/key.pem", folder + "/certificate.pem"
    words = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 9 -subj /CN=lightwell -addext"
    subprocess.run(["openssl"] + words.split() + ["subjectAltName=DNS:localhost,IP:127.0.0.1", "-keyout", key, "-out",
                    certificate], check=True, stderr=subprocess.DEVNULL)
    return ["--tls-certificate", certificate, "--tls-key", key]


class Server:
    def __init__(self, options, folder, tls):
        self.log = open(folder + "/log", "w+")
        ports = [folder + "/port", folder + "/http", folder + "/metrics"]
        for path in ports:
            if os.path.exists(path):
                os.unlink(path)
        self.access = ["--ca", folder + "/certificate.pem"] if tls else []
        words = [program("lightwelld")] + options.scene + "--control-socket none --log-format text".split()
        for what, path in zip(("", "http-", "metrics-"), ports):
            words += [f"--{what.rstrip('-') or 'listen'}", "127.0.0.1:0", f"--{what}port-file", path]
        words += make_certificate(folder) if tls else []
        self.process = subprocess.Popen(words, stderr=self.log, stdout=subprocess.DEVNULL)
        for _ in range(3000):
            time.sleep(0.1)
            self.log.flush()
            if self.process.poll() is not None:
                sys.exit(open(folder + "/log").read())
            if "first light" in open(folder + "/log").read():
                break
        self.port, self.http, self.metrics = [int(open(path).read()) for path in ports]

    def cpu_s(self):
        """Of the network's thread, of all."""
        text = urllib.request.urlopen(f"http://127.0.0.1:{self.metrics}/metrics").read().decode()
        stages = dict(re.findall(r'lightwell_cpu_seconds_total{stage="(\w+)"} ([\d.e+-]+)', text))
        return float(stages["serve"]), float(re.search(r"^process_cpu_seconds_total ([\d.e+-]+)", text, re.M)[1])

    def memory_mb(self):
        status = open(f"/proc/{self.process.pid}/status").read()
        return int(re.search(r"VmRSS:\s*(\d+)", status)[1]) / 1000

    def stop(self):
        self.process.terminate()
        if self.process.wait(60) != 0:
            sys.exit(f"lightwelld ended with {self.process.returncode}")


def measure(server, options, kind):
    """One row; kind None: nobody is hostile."""
    hostile = None
    if kind:
        port = server.http if kind in WEB else server.port
        hostile = subprocess.Popen(
            ["nice", "-n", str(options.nice), program("bench_hostile"), f"127.0.0.1:{port}", kind,
             str(options.count), str(options.seconds + 4), "127.0.0.2"], stdout=subprocess.PIPE, text=True)
        time.sleep(1)
    cpu_s, began = server.cpu_s(), time.time()
    honest = subprocess.run(
        [program("lightwell-load"), f"localhost:{server.port}", "--users", str(options.honest), "--seconds",
         str(options.seconds), "--path", options.path, "--json"] + server.access, capture_output=True, text=True)
    elapsed_s = time.time() - began
    loop, cores = [(after - before) / elapsed_s for before, after in zip(cpu_s, server.cpu_s())]
    did = "| | |"
    if hostile:
        found = re.search(r"([\d.]+) MB written, closed (\d+) times, ([\d.]+) CPU s", hostile.communicate()[0])
        did = f"| {found[1]} | {int(found[2]):,} | {float(found[3]) / (options.seconds + 4):.2f}"
    else:
        did = "| | |"
    try:
        said = json.loads(honest.stdout)
        ping, age = said["ping_ms"], said["light_age_ms"]
        times = f"{ping['p50']:.2f} / {ping['p99']:.1f} | {age['p50']:.0f} / {age['p99']:.0f}"
    except (ValueError, KeyError, TypeError):
        times = "no answer |"
        sys.stderr.write(honest.stderr)
    load = os.getloadavg()[0]
    print(f"| {kind or 'nothing'} | {times} {did} | {loop:.2f} of {cores:.2f} | {server.memory_mb():.0f} "
          f"| {load:.1f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="builtin:atrium-matt", help="scene and options of lightwelld")
    parser.add_argument("--kinds", default=" ".join(PLAIN + BY_TLS))
    parser.add_argument("--count", type=int, default=128)
    parser.add_argument("--honest", type=int, default=100)
    parser.add_argument("--path", default="walk")
    parser.add_argument("--seconds", type=int, default=12)
    parser.add_argument("--nice", type=int, default=0)
    options = parser.parse_args()
    options.scene = options.scene.split()
    kinds = options.kinds.split()
    print("| kind | ping p50 / p99, ms | age of light, ms | MB written | closed | its cores "
          "| loop's, of the server's cores | server's MB | load |")
    print("|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for tls in (False, True):
            those = [kind for kind in kinds if (kind in BY_TLS) == tls]
            if not those:
                continue
            server = Server(options, folder, tls)
            measure(server, options, None)
            for kind in those:
                measure(server, options, kind)
            server.stop()


if __name__ == "__main__":
    main()
