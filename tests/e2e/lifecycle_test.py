"""gantry run: how it comes up, who it refuses, how it ends, and what goes on after that."""

import json
import os
import pwd
import signal
import socket
import stat
import subprocess
import sys
import time
import unittest

from gantry_e2e import BINARY, EVERY_READ, READER, EndToEnd, Process, run
from silion import SilionReader, new_epc


class Start(EndToEnd):
    def test_it_says_where_it_listens_and_then_that_it_is_ready(self):
        gateway = self.gateway()
        self.assertEqual([f"listening on 127.0.0.1:{gateway.port}", "ready"], gateway.process.out.lines())
        socket.create_connection(("127.0.0.1", gateway.port)).close()

    def test_every_listener_has_its_line(self):
        gateway = self.gateway(READER + READER.replace("gate-", "dock-"))
        self.assertEqual(2, len(set(gateway.ports)))
        for port, name in zip(gateway.ports, ("gate-1", "dock-1")):
            reader = SilionReader(port, name)
            reader.upload(new_epc())
            reader.close()

    def test_with_json_each_line_is_an_object(self):
        gateway = self.gateway(start=False)
        process = self.under_way(Process(["run", "--json", "-c", gateway.write_config()]))
        process.wait_for_line("ready")
        listening, ready = map(json.loads, process.out.lines())
        self.assertEqual({"ready": True}, ready)
        host, port = listening["listening"].rsplit(":", 1)
        socket.create_connection((host, int(port))).close()
        self.assertEqual(0, process.end())

    def test_the_api_is_up_when_it_says_ready(self):
        gateway = self.gateway()
        self.assertEqual({"status": "ok"}, gateway.ask("GET", "/healthz").json())
        self.assertEqual("e2e", gateway.status()["id"])

    def test_the_file_in_the_working_directory_is_used(self):
        gateway = self.gateway(start=False)
        gateway.write_config()
        process = self.under_way(Process(["run"], cwd=gateway.home))
        process.wait_for_line("^ready$")
        self.assertTrue(gateway.db.exists())
        self.assertEqual(0, process.end())

    def test_data_dir_on_the_command_line_goes_before_the_file(self):
        gateway = self.gateway(start=False)
        elsewhere = gateway.home / "elsewhere"
        process = self.under_way(Process(["run", "-c", gateway.write_config(), "--data-dir", elsewhere]))
        process.wait_for_line("^ready$")
        self.assertTrue((elsewhere / "gantry.db").exists())
        self.assertFalse(gateway.data.exists())
        self.assertEqual(0, process.end())


@unittest.skipUnless(os.geteuid() == 0, "needs root to be another user")
class Defaults(EndToEnd):
    """Root's data lie in /var/lib; everyone else's in their home. So these run as somebody else."""

    def start_as_nobody(self, home, **env):
        user = pwd.getpwnam("nobody")
        os.chown(home, user.pw_uid, user.pw_gid)
        binary = home / "gantry"  # a build directory under /root is closed to others
        binary.write_bytes(open(BINARY, "rb").read())
        binary.chmod(0o755)
        command = [sys.executable, "-c",
                   f"import os; os.setgroups([]); os.setgid({user.pw_gid}); os.setuid({user.pw_uid});"
                   f"os.execv({str(binary)!r}, ['gantry', 'run'])"]
        process = subprocess.Popen(command, cwd=home, env={"HOME": str(home), **env}, stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.stderr.close)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        self.assertEqual("ready\n", process.stdout.readline(), "it did not come up")
        return process

    def test_without_a_file_data_go_to_the_users_state(self):
        home = self.directory()
        process = self.start_as_nobody(home)
        data = home / ".local/state/gantry"
        self.assertTrue((data / "gantry.db").exists())
        self.assertEqual(0o700, stat.S_IMODE(data.stat().st_mode))
        process.terminate()
        self.assertEqual(0, process.wait())

    def test_xdg_state_home_goes_before_home(self):
        home = self.directory()
        state = home / "state"
        process = self.start_as_nobody(home, XDG_STATE_HOME=str(state))
        self.assertTrue((state / "gantry/gantry.db").exists())
        self.assertFalse((home / ".local").exists())
        process.terminate()
        self.assertEqual(0, process.wait())


class Refusals(EndToEnd):
    def test_a_second_gateway_in_the_same_directory(self):
        gateway = self.gateway()
        second = run("run", "-c", gateway.config)
        self.assert_refused(second, "another gateway is running", gateway.data)
        reader = SilionReader(gateway.port)
        reader.upload(new_epc())  # the first took no harm
        reader.close()

    def test_a_port_in_use_is_named(self):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            gateway = self.gateway(READER.replace(":0", f":{port}"), start=False)
            self.assert_refused(run("run", "-c", gateway.write_config()), f"127.0.0.1:{port}", "in use")

    def test_an_address_that_is_not_ours(self):
        gateway = self.gateway(READER.replace("127.0.0.1:0", "192.0.2.1:9055"), start=False)
        self.assert_refused(run("run", "-c", gateway.write_config()), "192.0.2.1:9055")

    def test_a_data_directory_that_is_a_file(self):
        gateway = self.gateway(start=False)
        gateway.data.write_text("no directory")
        self.assert_refused(run("run", "-c", gateway.write_config()), gateway.data, "data_dir")

    def test_a_store_that_is_no_database(self):
        gateway = self.gateway(start=False)
        gateway.data.mkdir()
        gateway.db.write_bytes(b"these are not the bytes of a database\n" * 200)
        self.assert_refused(run("run", "-c", gateway.write_config()), gateway.db)
        self.assertTrue(gateway.db.read_bytes().startswith(b"these are not"), "it must not be touched")


class End(EndToEnd):
    def end_with(self, number):
        gateway = self.gateway(READER + EVERY_READ)
        reader = SilionReader(gateway.port)
        tags = [new_epc() for _ in range(20)]
        for tag in tags:
            reader.upload(tag)
        begun = time.monotonic()
        gateway.process.send_signal(number)
        self.assertEqual(0, gateway.process.wait())
        self.assertLess(time.monotonic() - begun, 2.0)
        reader.wait_for_the_end()
        self.assertEqual(set(tags), {row["tag"] for row in gateway.events("tag.read")})
        self.assertEqual("the gateway stops", gateway.events("reader.disconnected")[0]["reason"])
        self.assertFalse((gateway.data / "gantry.sock").exists())
        reader.close()

    def test_sigterm_ends_it_at_once_with_all_stored(self):
        self.end_with(signal.SIGTERM)

    def test_ctrl_c_does_the_same(self):
        self.end_with(signal.SIGINT)

    def test_it_ends_at_once_with_a_command_under_way(self):
        gateway = self.gateway()
        reader = SilionReader(gateway.port)
        reader.heartbeat()
        gateway.wait_for_events(1, "reader.connected")
        asking = self.under_way(gateway.begin("gpio", "get", "gate-1", "--timeout", "60s"))
        reader.next_command()  # and never answers
        begun = time.monotonic()
        self.assertEqual(0, gateway.process.end())
        self.assertLess(time.monotonic() - begun, 2.0)
        self.assertEqual(1, asking.wait())
        reader.close()

    def test_what_is_sent_while_it_ends_is_either_acknowledged_and_stored_or_neither(self):
        gateway = self.gateway(READER + EVERY_READ)
        reader = SilionReader(gateway.port)
        acknowledged = set()
        tags = [new_epc() for _ in range(2000)]
        try:
            for number, tag in enumerate(tags):
                reader.upload(tag)
                acknowledged.add(tag)
                if number == 30:
                    gateway.process.send_signal(signal.SIGTERM)
        except OSError:
            pass  # that is how a reader learns of it
        self.assertEqual(0, gateway.process.wait())
        stored = [row["tag"] for row in gateway.events("tag.read")]
        self.assertEqual(len(set(stored)), len(stored))
        self.assertLessEqual(acknowledged, set(stored))
        self.assertLess(len(acknowledged), len(tags))
        reader.close()


class Restart(EndToEnd):
    def feed(self, gateway, tag):
        reader = SilionReader(gateway.port)
        reader.upload(tag)
        reader.close()
        gateway.wait_for_events(1, "tag.read", tag=tag)

    def test_ids_and_numbers_go_on(self):
        gateway = self.gateway(READER + EVERY_READ, head="")
        self.feed(gateway, new_epc())
        name = gateway.status()["id"]
        for again in (gateway.restart, gateway.kill_and_restart, gateway.restart):
            again()
            self.assertEqual(name, gateway.status()["id"])
            self.feed(gateway, new_epc())
        rows = gateway.events()
        self.assertEqual(list(range(1, len(rows) + 1)), [row["seq"] for row in rows])
        self.assertEqual([f"{name}:{row['seq']}" for row in rows], [row["id"] for row in rows])

    def test_two_gateways_make_different_ids(self):
        ids = {self.gateway(head="").status()["id"] for _ in range(2)}
        self.assertEqual(2, len(ids))

    def test_a_socket_left_by_a_killed_gateway_is_no_obstacle(self):
        gateway = self.gateway()
        gateway.kill()
        self.assertTrue((gateway.data / "gantry.sock").exists())
        gateway.start()
        self.assertEqual("e2e", gateway.status()["id"])


class Files(EndToEnd):
    def mode(self, path):
        return stat.S_IMODE(path.stat().st_mode)

    def test_they_are_only_for_the_user_that_runs_it(self):
        before = os.umask(0)  # it must not lean on a umask
        try:
            gateway = self.gateway()
        finally:
            os.umask(before)
        reader = SilionReader(gateway.port)
        reader.upload(new_epc())
        reader.close()
        self.assertEqual(0o700, self.mode(gateway.data))
        files = [path for path in gateway.data.iterdir()]
        self.assertLessEqual({"gantry.db", "gantry.db-wal", "gantry.sock"}, {path.name for path in files})
        self.assertEqual({path.name: "0o600" for path in files}, {path.name: oct(self.mode(path)) for path in files})

    def test_the_mode_of_a_directory_that_was_there_is_left_alone(self):
        gateway = self.gateway(start=False)
        gateway.data.mkdir()
        gateway.data.chmod(0o750)
        gateway.start()
        self.assertEqual(0o750, self.mode(gateway.data))


if __name__ == "__main__":
    unittest.main()
