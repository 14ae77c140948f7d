"""The destinations of a proof: real servers on loopback, each with what it has received, in the order in which it came.

A destination can be killed and brought back, cut off without a word, and says at the end what it holds. Where its clients
can be made to go through one, a proxy stands between the gateway and it."""

import glob
import json
import os
import pwd
import shutil
import signal
import subprocess
import time
from pathlib import Path

from .collect import MqttSubscriber, NatsClient
from .processes import PATIENCE, ROOT, Program, Trouble, answers, find_program, free_port, wait_for
from .proxy import Proxy

QUICK_RETRY = 'retry_min = "50ms"\n'


class Destination:
    name = kind = ""
    idempotent = False  # it drops ids that it has
    restarts = True     # it can be killed and brought back
    note = ""

    def __init__(self, home, build, more=""):
        self.home, self.build, self.more = Path(home) / self.name, build, more
        self.home.mkdir(mode=0o755)
        self.process = self.proxy = None

    def section(self):
        return (f'[[sink]]\nname = "{self.name}"\ntype = "{self.kind}"\nstart = "oldest"\n{QUICK_RETRY}'
                f"{self.settings()}\n{self.more}")

    def settings(self):
        return ""

    def start(self):
        """Returns when it takes what is sent to it."""

    def kill(self):
        """As by kill -9 of all its processes."""

    def isolate(self):
        """Nothing passes between the gateway and it, and nobody is told."""
        self.proxy.stall()

    def heal(self):
        self.proxy.heal()

    def ids(self):
        """What it has taken, in order, with doubles. Only when the gateway has been stopped."""
        raise NotImplementedError

    def close(self):
        if self.process and self.process.running():
            self.process.kill()
        if self.proxy:
            self.proxy.close()


class Files(Destination):
    """JSON Lines: a directory, which nobody can kill; `kill` takes it away, as a disk that is not mounted."""

    name, kind = "files", "jsonl"

    def settings(self):
        return f'dir = "{self.home}/files"'

    def start(self):
        away, there = self.home / "away", self.home / "files"
        if away.exists():
            away.rename(there)
        there.mkdir(exist_ok=True)

    def kill(self):
        (self.home / "files").rename(self.home / "away")

    isolate = kill
    heal = start

    def lines(self):
        for file in sorted(glob.glob(f"{self.home}/files/*.jsonl")):
            with open(file, encoding="utf-8") as lines:
                yield from lines

    def ids(self):
        return [json.loads(line)["id"] for line in self.lines()]


class Mqtt(Destination):
    """mosquitto with a subscriber. The gateway gets to the broker only while the subscriber is there: what nobody subscribes to
    a broker confirms and throws away."""

    name = kind = "mqtt"
    note = "a broker with a subscriber; PUBACK means no more than that it passed the message on"

    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        self.port = free_port()
        (self.home / "mosquitto.conf").write_text(
            f"user root\npersistence false\nlog_dest stderr\nlog_type error\nlistener {self.port} 127.0.0.1\n"
            "allow_anonymous true\nmax_inflight_messages 500\nmax_queued_messages 0\n")
        self.subscriber = MqttSubscriber(self.port, "gantry/+/+/events")
        self.proxy = Proxy(self.port)
        self.proxy.refuse()

    def settings(self):
        return f'url = "mqtt://127.0.0.1:{self.proxy.port}"'

    def start(self):
        self.process = Program([find_program("mosquitto"), "-c", self.home / "mosquitto.conf"], self.home / "log")
        wait_for(lambda: answers(self.port), lambda: f"mosquitto listens; {self.process.said()}")
        self.subscriber.connect()
        self.proxy.welcome()

    def kill(self):
        self.process.kill()
        self.proxy.refuse()
        self.subscriber.drain()

    def ids(self):
        return [each for each, _ in self.subscriber.arrivals]

    def arrivals(self):
        return list(self.subscriber.arrivals)

    def close(self):
        self.subscriber.close()
        super().close()


class Nats(Destination):
    name = kind = "nats"
    idempotent = True
    note = "doubles are dropped within the stream's window of an hour"

    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        self.port = free_port()
        (self.home / "nats.conf").write_text(
            f'listen: "127.0.0.1:{self.port}"\njetstream {{ store_dir: "{self.home}/store", max_file: 8G }}\n')
        self.proxy = Proxy(self.port)

    def settings(self):
        return f'url = "nats://127.0.0.1:{self.proxy.port}"'

    def start(self):
        self.process = Program([find_program("nats-server"), "-c", self.home / "nats.conf"], self.home / "log")
        wait_for(self._ready, lambda: f"JetStream answers; {self.process.said()}")
        self.proxy.welcome()

    def _ready(self):
        try:
            client = NatsClient(self.port)
            try:
                return "error" not in client.ask("$JS.API.INFO", None)
            finally:
                client.close()
        except OSError:
            return False

    def kill(self):
        self.process.kill()
        self.proxy.refuse()

    def ids(self):
        client = NatsClient(self.port)
        try:
            return client.ids("GANTRY")
        finally:
            client.close()


class Kafka(Destination):
    """librdkafka's mock cluster as a process of its own. It keeps nothing when it ends, so killed means here that its brokers
    hang up and take no connections; cut off means that the process is stopped."""

    name = kind = "kafka"
    note = "the producer's own retries make no doubles; a crash of the gateway, or a time-out that leaves the fate open, does"
    partitions = 4

    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        self.brokers = ""
        self.collector = None
        self.process = None

    def settings(self):
        return f'url = "kafka://{self.brokers}"\nkey = "reader"'

    def _order(self, order):
        self.process.say(order)
        if self.process.line("done", "what?") != "done":
            raise Trouble(f"the cluster does not understand {order}")

    def start(self):
        if self.process:
            self._order("up")
            return
        self.process = Program([f"{self.build}/bin/gantry_kafka_cluster", "1"], self.home / "log")
        self.brokers = self.process.line("brokers ").split(" ", 1)[1]
        self._order(f"topic gantry.events {self.partitions}")
        self.collector = Program([f"{self.build}/bin/gantry_kafka_collector", self.brokers, "gantry.events", self.partitions,
                                  self.home / "ids"], self.home / "collector.log")
        self.collector.line("ready")

    def kill(self):
        self._order("down")

    def isolate(self):
        self.process.signal(signal.SIGSTOP)

    def heal(self):
        self.process.signal(signal.SIGCONT)

    def ids(self):
        """The collector is behind by the time of a fetch: it has all when nothing came for a while."""
        file, seen, since = self.home / "ids", -1, time.monotonic()
        while time.monotonic() - since < 2:
            size = file.stat().st_size if file.exists() else 0
            if size != seen:
                seen, since = size, time.monotonic()
            time.sleep(0.1)
        self.collector.stop()
        return file.read_text().split()

    def close(self):
        if self.collector and self.collector.running():
            self.collector.kill()
        super().close()


def _as_postgres(arguments):
    if os.geteuid() != 0:
        return arguments
    return [find_program("setpriv"), "--reuid=postgres", "--regid=postgres", "--clear-groups", *arguments]


class Postgres(Destination):
    name = kind = "postgres"
    idempotent = True

    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        self.port = free_port()
        versions = sorted(glob.glob("/usr/lib/postgresql/*/bin"), key=lambda each: int(each.split("/")[4]))
        if not versions:
            raise Trouble("PostgreSQL is not installed; see tools/packages.txt")
        self.bin = versions[-1]
        if os.geteuid() == 0:
            user = pwd.getpwnam("postgres")
            os.chown(self.home, user.pw_uid, user.pw_gid)
        made = subprocess.run(_as_postgres([f"{self.bin}/initdb", "-D", f"{self.home}/data", "-N", "-A", "trust", "-U", "postgres",
                                            "--locale=C", "-E", "UTF8", "--wal-segsize=1"]),
                              capture_output=True, text=True, cwd="/", check=False)
        if made.returncode:
            raise Trouble(f"no data directory could be made: {made.stderr}")
        self.proxy = Proxy(self.port)

    def settings(self):
        return f'url = "postgres://postgres@127.0.0.1:{self.proxy.port}/postgres"\nsslmode = "disable"'

    def start(self):
        arguments = [f"{self.bin}/postgres", "-D", f"{self.home}/data", "-p", str(self.port)]
        for setting in ("listen_addresses=127.0.0.1", "unix_socket_directories=", "shared_buffers=16MB", "autovacuum=off",
                        "fsync=off"):
            arguments += ["-c", setting]

        def up():  # what a killed server leaves behind may need a moment to end
            if not self.process or not self.process.running():
                self.process = Program(_as_postgres(arguments), self.home / "log", cwd="/")
            return answers(self.port) and self.sql("SELECT 1", wanted=False) == "1"
        wait_for(up, lambda: f"PostgreSQL answers; {self.process.said()}")
        self.proxy.welcome()

    def kill(self):
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        self.process.kill()
        for each in children:  # one that is left would end its transaction first
            try:
                os.kill(int(each), signal.SIGKILL)
            except ProcessLookupError:
                pass  # it went with its parent
        self.proxy.refuse()

    def sql(self, text, wanted=True):
        done = subprocess.run([find_program("psql"), "-h", "127.0.0.1", "-p", str(self.port), "-U", "postgres", "-XAtq", "-c", text],
                              capture_output=True, text=True, check=False, timeout=PATIENCE)
        if done.returncode and wanted:
            raise Trouble(f"psql: {done.stderr}")
        return done.stdout.strip()

    def ids(self):
        """By transaction, which have numbers in their order; within one all rows come at once."""
        return self.sql("SELECT id FROM gantry.events ORDER BY xmin::text::bigint, seq").split("\n")


class Webhook(Destination):
    """A web server whose behaviour a file decides, anew for each request."""

    name = kind = "webhook"

    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        self.port = free_port()
        self.proxy = Proxy(self.port)

    def settings(self):
        return f'url = "http://127.0.0.1:{self.proxy.port}/"'

    def start(self):
        program = ROOT / "src/sinks/webhook/tests/webhook_server.py"
        self.process = Program(["python3", "-B", program, self.port, self.home], self.home / "log")
        self.process.line("ready")
        self.proxy.welcome()

    def kill(self):
        self.process.kill()
        self.proxy.refuse()

    def behave(self, **behaviour):
        new = self.home / "behaviour.new"
        new.write_text(json.dumps(behaviour))
        new.rename(self.home / "behaviour")

    def requests(self):
        file = self.home / "requests"
        return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []

    def ids(self):
        file = self.home / "ids"
        return file.read_text().split() if file.exists() else []


KINDS = {each.name: each for each in (Files, Mqtt, Nats, Kafka, Postgres, Webhook)}


def make(names, home, build, more=None):
    unknown = set(names) - set(KINDS)
    if unknown:
        raise Trouble(f"there is no sink {', '.join(sorted(unknown))}; there are {', '.join(KINDS)}")
    if shutil.disk_usage(home).free < 1 << 30:
        raise Trouble(f"less than 1 GiB is free in {home}")
    return {name: KINDS[name](home, build, (more or {}).get(name, "")) for name in names}
