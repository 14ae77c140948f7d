"""Real servers on loopback for sinks: each starts on the same address every time, and can be killed as kill -9 does.

They keep what they hold in a directory of the caller's. Ports lie below the range from which the system takes them for
connections, so nobody takes one while its server is down.
"""

import atexit
import fcntl
import http.server
import os
import pwd
import random
import re
import shutil
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path

START_TIME = 60.0  # seconds for what should take one: the machine may be busy


class ServerError(Exception):
    """A server that is not there or does not start: which, and what it said."""


def free_port():
    for _ in range(1000):
        port = random.randrange(10_000, 30_000)
        with socket.socket() as each:
            try:
                each.bind(("127.0.0.1", port))
                return port
            except OSError:
                pass
    raise ServerError("there is no free port")


def answers(port):
    try:
        socket.create_connection(("127.0.0.1", port), timeout=1).close()
        return True
    except OSError:
        return False


def program(name):
    found = shutil.which(name, path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
    if not found:
        raise ServerError(f"{name} is not installed: ./dev deps")
    return found


class Server:
    """A process that listens on `port`; its kinds say what its command is and when it is ready."""

    def __init__(self, home):
        self.home, self.port, self._process = Path(home), free_port(), None
        atexit.register(self.kill)

    def command(self):
        raise NotImplementedError

    def ready(self):
        return answers(self.port)

    def start(self):
        log = self.home / "server.log"
        end = time.monotonic() + START_TIME
        while True:
            if self._process is None or self._process.poll() is not None:  # another one may not have gone yet
                with open(log, "ab") as out:
                    self._process = subprocess.Popen(self.command(), stdout=out, stderr=out, stdin=subprocess.DEVNULL)
            if self.ready():
                return self
            if time.monotonic() > end:
                raise ServerError(f"{self.command()[0]} does not start: {log.read_text(errors='replace')[-2000:]}")
            time.sleep(0.02)

    def kill(self):
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


class Mosquitto(Server):
    """It holds nothing that a kill would leave. Without Nagle's delay, which clients bear unequally."""

    @property
    def url(self):
        return f"mqtt://127.0.0.1:{self.port}"

    def command(self):
        config = self.home / "mosquitto.conf"
        config.write_text(f"user root\npersistence false\nlistener {self.port} 127.0.0.1\nallow_anonymous true\n"
                          "max_queued_messages 0\nset_tcp_nodelay true\n")
        return [program("mosquitto"), "-c", str(config)]


class Nats(Server):
    """With JetStream, in files."""

    @property
    def url(self):
        return f"nats://127.0.0.1:{self.port}"

    def command(self):
        return [program("nats-server"), "-a", "127.0.0.1", "-p", str(self.port), "-js", "-sd", str(self.home / "nats")]


class Postgres(Server):
    """Whom it lets in from loopback it trusts; the user is postgres, the database too. `sync`: safe against a power
    cut, as servers of users are. `template`: where a data directory lies that only has to be copied, or comes to lie;
    the tests in C++ share it (src/sinks/postgres/tests/server.hpp)."""

    def __init__(self, home, sync=False, template=None):
        super().__init__(home)
        self._sync, self._data = sync, self.home / "postgres"
        versions = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda each: int(each.parent.name))
        if not versions:
            raise ServerError("PostgreSQL is not installed: ./dev deps")
        self._bin = versions[-1]
        if template:
            self._copy(Path(template))
        else:
            self._data.mkdir()
            self._give_away()
            self._make()
        with open(self._data / "pg_hba.conf", "w", encoding="utf-8") as access:
            access.write("host all all 127.0.0.1/32 trust\n")
        self._give_away()

    def _make(self):
        self._run("initdb", "-D", self._data, "-N", "-A", "trust", "-U", "postgres", "--locale=C", "-E", "UTF8",
                  "--wal-segsize=1")
        self._run("pg_resetwal", "-D", self._data)  # less to copy
        for database in ("1", "4"):  # template1 and template0, two thirds of all: nobody looks at them
            shutil.rmtree(self._data / "base" / database)

    def _copy(self, template):
        with open(f"{template}.lock", "a", encoding="utf-8") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (template / "PG_VERSION").exists():
                self._data.mkdir()
                self._give_away()
                self._make()
                shutil.rmtree(template, ignore_errors=True)
                shutil.copytree(self._data, f"{template}.new")
                os.rename(f"{template}.new", template)
        if not self._data.exists():
            shutil.copytree(template, self._data)
        self._data.chmod(0o700)

    def _give_away(self):
        """It refuses to run as root."""
        if os.geteuid() != 0:
            return
        self.home.chmod(0o755)
        user = pwd.getpwnam("postgres")
        os.chown(self._data, user.pw_uid, user.pw_gid)
        for folder, folders, files in os.walk(self._data):
            for each in folders + files:
                os.chown(os.path.join(folder, each), user.pw_uid, user.pw_gid)

    @property
    def url(self):
        return f"postgres://postgres@127.0.0.1:{self.port}/postgres"

    def _as_postgres(self, name, *arguments):
        words = [str(self._bin / name), *map(str, arguments)]
        if os.geteuid() == 0:
            words = ["/usr/bin/setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups", *words]
        return words

    def _run(self, name, *arguments):
        done = subprocess.run(self._as_postgres(name, *arguments), capture_output=True, text=True, check=False,
                              cwd="/")
        if done.returncode != 0:
            raise ServerError(f"{name} failed: {done.stderr}")

    def command(self):
        settings = ["listen_addresses=127.0.0.1", "unix_socket_directories=",
                    f"fsync={'on' if self._sync else 'off'}"]
        return self._as_postgres("postgres", "-D", self._data, "-p", self.port,
                                 *(word for each in settings for word in ("-c", each)))

    def ready(self):
        return answers(self.port) and self._ask("SELECT 1").returncode == 0

    def _ask(self, sql):
        return subprocess.run(["psql", "-X", "-A", "-t", "-F", "\t", "-v", "ON_ERROR_STOP=1", "-c", sql,
                               "-h", "127.0.0.1", "-p", str(self.port), "-U", "postgres", "postgres"],
                              capture_output=True, text=True, check=False)

    def rows(self, sql):
        """Lists of texts; an empty text for NULL."""
        done = self._ask(sql)
        if done.returncode != 0:
            raise ServerError(done.stderr)
        return [line.split("\t") for line in done.stdout.splitlines()]

    def kill(self):
        """With its sessions: one that is left could still end its transaction."""
        if self._process is None:
            return
        children = subprocess.run(["ps", "-o", "pid=", "--ppid", str(self._process.pid)], capture_output=True,
                                  text=True, check=False).stdout.split()
        super().kill()
        for child in map(int, children):
            try:
                os.kill(child, signal.SIGKILL)
            except ProcessLookupError:
                pass


class KafkaCluster:
    """librdkafka's mock of a cluster, a process of its own (src/sinks/kafka/tests/cluster.cpp). It holds what it was
    given until it ends; its brokers can be told to be away."""

    def __init__(self, program_file, brokers=1):
        if not Path(program_file).exists():
            raise ServerError(f"{program_file} is not built")
        self._process = subprocess.Popen([str(program_file), str(brokers)], stdin=subprocess.PIPE, text=True,
                                         stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        atexit.register(self.close)
        line = self._process.stdout.readline()
        found = re.fullmatch(r"brokers (\S+)\n", line)
        if not found:
            raise ServerError(f"the cluster says {line!r}")
        self.url = f"kafka://{found[1]}"

    def order(self, *words):
        """The lines that it answers with, before its `done`."""
        self._process.stdin.write(" ".join(map(str, words)) + "\n")
        self._process.stdin.flush()
        lines = []
        for line in self._process.stdout:
            if line == "done\n":
                return lines
            if line == "what?\n":
                raise ServerError(f"the cluster does not understand {words}")
            lines.append(line.rstrip("\n"))
        raise ServerError("the cluster has ended")

    def start(self):
        self.order("up")
        return self

    def kill(self):
        self.order("down")

    def close(self):
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._process.stdin.close()
        self._process.stdout.close()


class WebReceiver:
    """Takes every POST and keeps nothing: for measuring."""

    class _Handler(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        rbufsize = 1 << 20
        disable_nagle_algorithm = True

        def do_POST(self):
            self.rfile.read(int(self.headers["Content-Length"]))
            self.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n")

        def log_message(self, *_):
            pass

    def __init__(self):
        self._server, self.port = None, free_port()
        self.url = f"http://127.0.0.1:{self.port}/events"

    def start(self):
        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", self.port), self._Handler)
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def kill(self):
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None
