"""Destinations beside the store: in order, under the same ids, whatever dies; what one will not take is kept."""

import contextlib
import http.server
import json
import sqlite3
import threading
import unittest

from gantry_e2e import EVERY_READ, READER, EndToEnd, wait_for
from outage import without_doubles
from silion import SilionReader, new_epc


class Receiver:
    """A web server that takes batches of events, or does not."""

    def __init__(self):
        self.ids, self.poison, self.status, self.requests = [], set(), 200, 0
        receiver = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                status = receiver.take(json.loads(body))
                self.send_response(status)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, *_):
                pass

        class Server(http.server.ThreadingHTTPServer):
            def handle_error(self, *_):
                pass  # the gateway was killed in the middle of a request

        self._server = Server(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/events"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def take(self, events):
        self.requests += 1
        if self.status != 200:
            return self.status
        if any(event["id"] in self.poison for event in events):
            return 422
        self.ids += [event["id"] for event in events]
        return 200

    def close(self):
        self._server.shutdown()
        self._server.server_close()


class SinkTest(EndToEnd):
    def receiver(self):
        receiver = Receiver()
        self.addCleanup(receiver.close)
        return receiver

    def webhook(self, receiver, more=""):
        return f'[[sink]]\nname = "hook"\ntype = "webhook"\nurl = "{receiver.url}"\nretry_min = "50ms"\n{more}\n'

    def archive(self, directory, more=""):
        return f'[[sink]]\nname = "archive"\ntype = "jsonl"\ndir = "{directory}"\n{more}\n'

    def lines(self, directory):
        out = []
        for file in sorted(directory.glob("archive-*.jsonl")):
            out += [json.loads(line) for line in file.read_text().splitlines()]
        return out

    def feed(self, gateway, frames, tags=5):
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        for _ in range(frames):
            reader.tags(*[new_epc() for _ in range(tags)])
            reader.wait_for_ack()
        return reader

    def stored_ids(self, gateway):
        return [row["id"] for row in gateway.store().rows("SELECT id FROM events ORDER BY seq")]

    def sink(self, gateway, name):
        return json.loads(self.assert_done(gateway.cli("sink", "show", name, "--json")).out)


class Delivery(SinkTest):
    def test_every_event_of_the_store_gets_to_every_sink_in_order(self):
        receiver, directory = self.receiver(), self.directory()
        gateway = self.gateway(READER + EVERY_READ + self.webhook(receiver) + self.archive(directory))
        self.feed(gateway, 20)
        gateway.wait_for_events(100, "tag.read")
        wait_for(lambda: receiver.ids and receiver.ids == self.stored_ids(gateway), "the web server has all")
        wait_for(lambda: [each["id"] for each in self.lines(directory)] == self.stored_ids(gateway), "the file has all")
        in_store = {row["id"]: row for row in gateway.events()}
        for event in self.lines(directory):
            row = in_store[event["id"]]
            self.assertEqual(row["type"], event["type"])
            self.assertEqual(row.get("tag"), event.get("tag"))
            self.assertEqual(row["time"], event["time"])
        listed = gateway.cli("sink", "list")
        self.assertRegex(listed.out, r"hook +webhook +\d+ +\d+ +0  ")
        self.assertRegex(listed.out, r"archive +jsonl +")
        wait_for(lambda: self.sink(gateway, "hook")["state"] == "up to date", "nothing waits")
        self.assertEqual(0, self.sink(gateway, "hook")["behind"])

    def test_a_sink_that_is_away_holds_up_nobody_and_gets_all_when_it_is_back(self):
        receiver, directory = self.receiver(), self.directory()
        receiver.status = 500
        gateway = self.gateway(READER + EVERY_READ + self.webhook(receiver) + self.archive(directory))
        self.feed(gateway, 10)
        wait_for(lambda: [each["id"] for each in self.lines(directory)] == self.stored_ids(gateway), "the other has all")
        wait_for(lambda: receiver.requests > 2, "it is tried again and again")
        state = self.sink(gateway, "hook")
        self.assertGreater(state["behind"], 0)
        self.assertIn("500", state["trouble"])
        self.assertEqual([], receiver.ids)
        receiver.status = 200
        wait_for(lambda: receiver.ids == self.stored_ids(gateway), "it has all")
        self.assertNotIn("trouble", wait_for(
            lambda: (state := self.sink(gateway, "hook"))["behind"] == 0 and state, "nothing waits"))

    def test_only_what_was_asked_for_and_from_the_oldest_on(self):
        receiver, directory = self.receiver(), self.directory()
        gateway = self.gateway(READER + EVERY_READ)
        self.feed(gateway, 3)
        gateway.wait_for_events(15, "tag.read")
        gateway.toml += self.webhook(receiver, 'types = ["tag.new"]\nstart = "oldest"') + self.archive(
            directory, 'types = ["reader.*"]')
        before = gateway.store().number("SELECT max(seq) FROM events")
        gateway.restart()
        self.feed(gateway, 1)
        new = lambda: [row["id"] for row in gateway.events("tag.new")]
        wait_for(lambda: len(new()) == 20 and receiver.ids == new(), "all tags, those from before too")
        found = wait_for(lambda: self.lines(directory), "the new reader")
        for event in found:
            self.assertTrue(event["type"].startswith("reader."), event)
            self.assertGreater(event["seq"], before, "a new sink starts now")


class Deaths(SinkTest):
    def test_nothing_is_lost_when_the_gateway_is_killed_again_and_again(self):
        receiver, directory = self.receiver(), self.directory()
        gateway = self.gateway(READER + EVERY_READ + self.webhook(receiver, 'batch = 7') + self.archive(directory))
        for _ in range(6):
            self.feed(gateway, 8)
            gateway.kill_and_restart()
        self.feed(gateway, 1)
        wait_for(lambda: without_doubles(receiver.ids) == self.stored_ids(gateway),
                 lambda: f"{len(set(receiver.ids))} of {len(self.stored_ids(gateway))}")
        wait_for(lambda: without_doubles([each["id"] for each in self.lines(directory)]) == self.stored_ids(gateway),
                 "the file has all")
        self.assertEqual(245, gateway.reads_of())

    def test_a_crash_between_delivery_and_mark_delivers_twice_under_one_id(self):
        receiver = self.receiver()
        toml = READER + EVERY_READ + self.webhook(receiver, 'start = "oldest"')
        gateway = self.gateway(toml, env={"GANTRY_FAILPOINT": "sink_delivered"})
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        with contextlib.suppress(OSError):  # that the reader is there is an event, which may have been the end
            reader.tags(new_epc())
        wait_for(lambda: not gateway.running(), "it has ended in the middle")
        self.assertTrue(receiver.ids)
        first = list(receiver.ids)
        gateway.process.wait()
        gateway.env = None
        gateway.start()
        wait_for(lambda: all(receiver.ids.count(each) >= 2 for each in first), "what was delivered comes again, under one id")
        wait_for(lambda: without_doubles(receiver.ids) == self.stored_ids(gateway), "all are there")


class Places(SinkTest):
    def test_a_place_beyond_the_newest_event_is_not_believed(self):
        receiver = self.receiver()
        gateway = self.gateway(READER + EVERY_READ + self.webhook(receiver))
        self.feed(gateway, 2)
        wait_for(lambda: self.sink(gateway, "hook")["behind"] == 0 and receiver.ids, "it has all")
        gateway.stop()
        with contextlib.closing(sqlite3.connect(gateway.db)) as store, store:
            store.execute("UPDATE cursors SET seq = 1000000 WHERE sink = 'hook'")
        receiver.ids.clear()
        gateway.start()
        self.assertIn("beyond the newest event", gateway.log())
        self.feed(gateway, 1)
        wait_for(lambda: without_doubles(receiver.ids) == self.stored_ids(gateway), "it has all again, and what came since")


class DeadLetters(SinkTest):
    def test_what_is_refused_is_kept_with_the_reason_and_can_be_offered_again(self):
        receiver = self.receiver()
        gateway = self.gateway(READER + EVERY_READ + self.webhook(receiver))
        receiver.poison = {"e2e:4", "e2e:6"}
        self.feed(gateway, 4)
        wait_for(lambda: without_doubles(receiver.ids) == [
            each for each in self.stored_ids(gateway) if each not in receiver.poison] and receiver.ids, "all others are there")
        letters = lambda: gateway.cli("sink", "show", "hook", "--dead", "--json").json_lines()
        found = wait_for(lambda: len(found := letters()) == 2 and found, "two dead letters")
        self.assertEqual([4, 6], [each["event"] for each in found])
        self.assertIn("422", found[0]["reason"])
        self.assertEqual("e2e:4", found[0]["content"]["id"])
        self.assertIn("422", gateway.cli("sink", "show", "hook", "--dead").out)
        wait_for(lambda: self.sink(gateway, "hook")["dead_letters"] == 2, "they are counted")

        gateway.restart()
        self.assertEqual(2, len(letters()), "they outlive the process")
        receiver.poison = {"e2e:6"}
        self.assert_done(gateway.cli("sink", "retry", "hook", "--all"))
        found = wait_for(lambda: len(found := letters()) == 1 and found, "one is taken")
        self.assertEqual(6, found[0]["event"])
        wait_for(lambda: letters()[0]["tries"] == 2, "the other was tried again")
        self.assertIn("e2e:4", receiver.ids)
        self.assert_refused(gateway.cli("sink", "skip", "hook", "7"), "event 7 is no dead letter")
        self.assertIn("1 dead letter is thrown away", self.assert_done(gateway.cli("sink", "skip", "hook", "6")).out)
        wait_for(lambda: letters() == [], "it is thrown away")
        self.assertIn("No dead letters", gateway.cli("sink", "show", "hook", "--dead").out)

    def test_what_blocks_can_be_skipped(self):
        receiver = self.receiver()
        receiver.status = 503
        gateway = self.gateway(READER + EVERY_READ + self.webhook(receiver, 'batch = 1'))
        self.feed(gateway, 1, tags=1)
        wait_for(lambda: "trouble" in self.sink(gateway, "hook"), "it waits")
        first = gateway.cli("sink", "show", "hook", "--json").json_lines()[0]["cursor"] + 1
        self.assert_done(gateway.cli("sink", "skip", "hook"))
        letters = lambda: gateway.cli("sink", "show", "hook", "--dead", "--json").json_lines()
        found = wait_for(letters, "a dead letter")
        self.assertEqual(first, found[0]["event"])
        self.assertIn("skipped by hand", found[0]["reason"])
        receiver.status = 200
        self.assert_done(gateway.cli("sink", "retry", "hook"))
        wait_for(lambda: receiver.ids == self.stored_ids(gateway)[first:], "the rest is there")
        self.assert_refused(gateway.cli("sink", "skip", "hook"), "nothing blocks")


class Words(SinkTest):
    def test_what_is_not_there_is_said(self):
        gateway = self.gateway()
        self.assertIn("No sink is configured", gateway.cli("sink", "list").out)
        self.assert_refused(gateway.cli("sink", "show", "nobody"), 'there is no sink "nobody"', "gantry sink list")
        self.assert_refused(gateway.cli("sink", "retry", "nobody", "--all"), "no sink")
        for method, path, status in (("POST", "/api/v1/sinks", 405), ("GET", "/api/v1/sinks/x/retry", 404)):
            self.assertEqual(status, gateway.ask(method, path, {} if method == "POST" else None).status)

    def test_a_sink_that_was_removed_is_told_of_and_holds_nothing(self):
        directory = self.directory()
        gateway = self.gateway(READER + self.archive(directory))
        self.feed(gateway, 1)
        wait_for(lambda: self.sink(gateway, "archive")["delivered"] > 0, "something is delivered")
        gateway.stop()
        gateway.toml = READER
        gateway.start()
        gateway.wait_for_message('"archive" is no longer configured')
        self.assertEqual([], gateway.ask("GET", "/api/v1/sinks").json()["sinks"])

    def test_wrong_requests_are_refused(self):
        directory = self.directory()
        gateway = self.gateway(READER + self.archive(directory))
        for method, path, body, status in (
                ("DELETE", "/api/v1/sinks/archive", None, 405), ("GET", "/api/v1/sinks/archive/retry", None, 405),
                ("POST", "/api/v1/sinks/archive/dead", {}, 405), ("POST", "/api/v1/sinks/archive/eat", {}, 404),
                ("POST", "/api/v1/sinks/archive/dead/retry", {}, 400),
                ("POST", "/api/v1/sinks/archive/dead/retry", {"events": []}, 400),
                ("POST", "/api/v1/sinks/archive/dead/retry", {"events": ["a"]}, 400),
                ("POST", "/api/v1/sinks/archive/dead/discard", {"events": [-1]}, 400),
                ("POST", "/api/v1/sinks/archive/dead/discard", {"events": [99999]}, 404),
                ("POST", "/api/v1/sinks/archive/dead/discard", "no JSON", 400),
                ("GET", "/api/v1/sinks/archive/dead?limit=0", None, 400),
                ("GET", "/api/v1/sinks/archive/dead?after=x", None, 400)):
            self.assertEqual(status, gateway.ask(method, path, body).status, (method, path, body))


if __name__ == "__main__":
    unittest.main()
