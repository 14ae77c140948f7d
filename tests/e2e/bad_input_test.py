"""Any bytes from any peer do no harm: the link ends with a word in the log, the
counters tell, and the reader beside it runs on."""

import random
import resource
import select
import socket
import struct
import time
import unittest

from gantry_e2e import EVERY_READ, READER, EndToEnd, wait_for
from silion import ACK, TAGS, SilionReader, Tag, frame, new_epc, record, tag_data

SHORT = 'identify_within = "1s"\n'
LEDGER = READER + SHORT + EVERY_READ


class BadInput(EndToEnd):
    def setUp(self):
        self.running = self.gateway(self.TOML)
        self.good = SilionReader(self.running.ports[-1], "gate-good")
        self.addCleanup(self.good.close)
        self.good.upload(new_epc())
        self.acknowledged = 1

    TOML = LEDGER

    def tearDown(self):
        """Whatever happened, the reader beside it is as well as ever."""
        self.good_goes_on()
        self.assertEqual(self.acknowledged, len(self.running.events("tag.read", reader="gate-good")))
        self.assertEqual([], self.running.events("reader.disconnected", reader="gate-good"))

    def good_goes_on(self):
        begun = time.monotonic()
        self.good.upload(new_epc())
        self.acknowledged += 1
        return time.monotonic() - begun

    def reader(self, name="gate-1", **more):
        reader = SilionReader(self.running.port, name, **more)
        self.addCleanup(reader.close)
        return reader

    def peer(self, data=b""):
        peer = socket.create_connection(("127.0.0.1", self.running.port))
        self.addCleanup(peer.close)
        peer.settimeout(20)
        peer.sendall(data)
        return peer

    def wait_for_the_end_of(self, peer):
        try:
            while peer.recv(4096):
                pass
        except ConnectionError:
            pass

    def counters(self, name="gate-1"):
        return self.running.reader_info(name)["counters"]


class Strangers(BadInput):
    """Those who never become a reader."""

    def test_another_protocol_is_recognised_by_its_first_bytes(self):
        hellos = {
            "GET / HTTP/1.1": b"GET / HTTP/1.1\r\nHost: gantry\r\nUser-Agent: curl/7.88.1\r\n\r\n",
            "SSH-2.0-OpenSSH_9.2p1": b"SSH-2.0-OpenSSH_9.2p1 Debian-2+deb12u3\r\n",
            r"\\x16\\x03\\x01\\x02\\x00": bytes.fromhex("16030102000100") + random.Random(1).randbytes(256),
        }
        for shown, hello in hellos.items():
            self.peer(hello).close()
            self.running.wait_for_message(rf'left without a name: closed by the reader; no Silion .*began with "{shown}')
            self.wait_for_the_end_of(self.peer(hello))
            self.running.wait_for_message(rf'^127.0.0.1:\d+ left without a name: no Silion .*began with "{shown}')

    def test_garbage_without_end_is_cut_off_early(self):
        peer = self.peer()
        noise = random.Random(2).randbytes(1 << 16)
        sent = 0
        with self.assertRaises(ConnectionError):
            while sent < 64 << 20:
                peer.sendall(noise)
                sent += len(noise)
        self.running.wait_for_message("left without a name: no Silion reader: the connection began with")

    def test_silence_ends_when_the_time_for_a_name_is_over(self):
        self.wait_for_the_end_of(self.peer())
        self.running.wait_for_message("left without a name: the peer said nothing for 1.0 s")

    def test_a_byte_a_while_does_not_buy_time(self):
        peer, message = self.peer(), frame("gate-1", TAGS, tag_data([Tag(new_epc())]))
        begun = time.monotonic()
        for byte in message[:-1]:
            peer.sendall(bytes([byte]))
            if select.select([peer], [], [], 0.1)[0]:
                break
        self.wait_for_the_end_of(peer)
        self.assertLess(time.monotonic() - begun, 10)
        self.running.wait_for_message("left without a name: no Silion frame within 1.0 s")

    def test_a_length_that_lies_ends_the_same_way(self):
        for length in (1, 0x7FFF, 0xFFFF):
            self.wait_for_the_end_of(self.peer(struct.pack(">BBHBBI", 0xFF, 6, length, TAGS, 0, 0) + b"gate-1"))
        wait_for(lambda: sum("no Silion frame within 1.0 s" in each for each in self.running.messages()) == 3, "three messages")

    def test_a_frame_that_breaks_off(self):
        whole = frame("gate-1", TAGS, tag_data([Tag(new_epc())]), ACK)
        for end in range(1, len(whole)):
            self.peer(whole[:end]).close()
        wait_for(lambda: self.running.listener()["connections"] == 1, "only the good reader is left")
        self.assertEqual({"gate-good"}, {row["reader"] for row in self.running.events("tag.read")})

    def test_every_listener_counts_those_without_a_name(self):
        peers = [self.peer() for _ in range(3)]
        wait_for(lambda: self.running.listener()["unnamed"] == 3, "three without a name")
        self.assertEqual(4, self.running.listener()["connections"])
        for peer in peers:
            self.wait_for_the_end_of(peer)
        wait_for(lambda: self.running.listener()["unnamed"] == 0, "none without a name")


class Crowds(BadInput):
    TOML = READER + EVERY_READ

    def setUp(self):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 8192), hard))
        super().setUp()

    def test_a_thousand_that_say_nothing_do_not_delay_a_reader(self):
        before = self.running.process.memory_mib()
        peers = [self.peer() for _ in range(1000)]
        wait_for(lambda: self.running.listener()["unnamed"] == 1000, "all are there")
        times = [self.good_goes_on() for _ in range(50)]
        self.assertLess(max(times), 2.0)
        if not self.running.process.is_sanitized():
            self.assertLess(self.running.process.memory_mib() - before, 32)
        for peer in peers:
            peer.close()
        wait_for(lambda: self.running.listener()["connections"] == 1, "only the good reader is left")

    def test_a_newcomer_displaces_the_oldest_that_says_nothing(self):
        peers = [self.peer() for _ in range(1100)]
        wait_for(lambda: self.running.listener()["displaced"] >= 76, "the oldest made room")
        self.wait_for_the_end_of(peers[0])
        self.running.wait_for_message("left without a name: made room: it did not say who it is")
        self.reader("gate-new").upload(new_epc())
        self.assertLessEqual(self.running.listener()["unnamed"], 1024)

    def test_a_flood_of_connections_leaves_nothing_behind(self):
        files = self.running.process.open_files()
        times = []
        for i in range(2000):
            self.peer(b"\xFF" if i % 2 else b"").close()
            if i % 100 == 0:
                times.append(self.good_goes_on())
        self.assertLess(max(times), 2.0)
        wait_for(lambda: self.running.listener()["connections"] == 1, "only the good reader is left")
        wait_for(lambda: self.running.process.open_files() <= files, "their files are closed")


class KnownReaders(BadInput):
    """Those that have said who they are, and then go wrong."""

    # Three seconds without a frame are too many; the good reader has a port, and patience, of its own.
    TOML = READER.replace('"60s"', '"1s"') + READER.replace("gate-*", "gate-good") + EVERY_READ

    def setUp(self):
        super().setUp()
        self.bad = self.reader()
        self.bad.heartbeat()
        self.running.wait_for_events(1, "reader.connected", reader="gate-1")

    def given_up(self):
        return self.running.wait_for_events(1, "reader.disconnected", reader="gate-1")[0]["reason"]

    def test_garbage_between_frames_is_skipped_and_counted(self):
        self.bad.send(b"\x00\x11 this is no frame \xFE")
        self.bad.upload(new_epc())
        counters = self.counters()
        self.assertEqual((21, 1), (counters["skipped_bytes"], counters["resyncs"]))

    def test_a_reader_that_loses_step_again_and_again_is_let_go(self):
        for _ in range(3):
            self.bad.send(b"no frame")
            self.bad.heartbeat()
        self.bad.wait_for_the_end()
        self.assertRegex(self.given_up(), "^lost step with the reader 3 times: 24 of its bytes")

    def test_silence_after_a_length_that_lies(self):
        self.bad.send(struct.pack(">BBHBBI", 0xFF, 6, 0xFFFF, TAGS, ACK, 0) + b"gate-1")
        self.assertEqual("no frame for 3.0 s, three heartbeat periods", self.given_up())

    def test_a_byte_a_while_does_not_count_as_being_alive(self):
        message = iter(struct.pack(">BBHBBI", 0xFF, 6, 0xFFFF, TAGS, ACK, 0) + b"gate-1" + b"\0" * 65535)

        def one_more():
            self.bad.send(bytes([next(message)]))
            return select.select([self.bad.socket], [], [], 0.1)[0]
        wait_for(one_more, "the reader is given up")
        self.assertEqual("no frame for 3.0 s, three heartbeat periods", self.given_up())

    def test_the_longest_frame_there_is_is_taken(self):
        tags = [Tag(new_epc()) for _ in range(65533 // 18)]
        self.bad.upload(*tags)
        self.assertEqual(len(tags), len(self.running.query("--type", "tag.read", "--reader", "gate-1")))

    def test_what_can_be_told_of_a_malformed_frame_is_told(self):
        whole, cut = Tag(new_epc()), Tag(new_epc())
        data = struct.pack(">H", 2) + record(whole) + record(cut)[:-4]
        sent = self.bad.send(self.bad.frame(TAGS, data, ACK))
        self.bad.wait_for_ack()
        self.assertEqual([whole.epc], [row["tag"] for row in self.running.events("tag.read", reader="gate-1")])
        fault = self.running.events("reader.fault", reader="gate-1")[0]
        self.assertEqual((-1, sent.hex().upper()), (fault["code"], fault["bytes"]))
        self.assertRegex(fault["text"], "^malformed tag frame: .*record 2 of the tags is cut off")
        self.assertEqual(1, self.counters()["malformed"])

    def test_an_epc_is_never_shortened(self):
        empty, longest, longer = Tag(""), Tag("AB" * 62), Tag("CD" * 63)
        self.bad.upload(empty, longest, longer)
        self.assertEqual([longest.epc], [row["tag"] for row in self.running.events("tag.read", reader="gate-1")])
        self.assertIn("2 tags with an empty or too long EPC", self.running.events("reader.fault")[0]["text"])

    def test_a_count_of_tags_that_lies(self):
        self.bad.send(self.bad.frame(TAGS, b"\xFF\xFF" + record(Tag(new_epc())), ACK))
        self.bad.wait_for_ack()
        self.assertEqual(1, self.counters()["malformed"])

    def test_codes_that_nobody_knows_are_counted(self):
        for code in (0, 6, 7, 0x14, 0x64, 0xFF):
            self.bad.send(self.bad.frame(code, b"what is this"))
        self.bad.upload(new_epc())
        self.assertEqual(6, self.counters()["unknown_code"])

    def test_mutated_frames_never_harm_anyone(self):
        chance = random.Random(3)
        for _ in range(150):
            message = bytearray(frame("gate-1", TAGS, tag_data([Tag(new_epc()), Tag(new_epc())]), ACK))
            for _ in range(chance.randint(1, 4)):
                message[chance.randrange(len(message))] = chance.randrange(256)
            reader = self.reader(f"gate-{chance.randrange(5)}")
            try:
                reader.heartbeat()
                reader.send(message)
            except OSError:
                pass  # it was let go
            reader.close()
        self.assertLess(self.good_goes_on(), 5)


class HostileNames(BadInput):
    TOML = LEDGER.replace("gate-*", "*")
    NAMES = {
        b"'; DROP TABLE event_rows; --": "'; DROP TABLE event_rows; --",
        b'"quoted"': '"quoted"',
        b"<script>alert(1)</script>": "<script>alert(1)</script>",
        b"../../../../etc/passwd": "../../../../etc/passwd",
        b"${jndi:ldap://x}/#/+/%s%n": "${jndi:ldap://x}/#/+/%s%n",
        b"tag,with,commas": "tag,with,commas",
        b"=cmd()": "=cmd()",
        b"a" * 255: "a" * 255,
        b"\\": "\\\\",
    }
    # A first frame whose name is not plain text is no frame: this make's names are ASCII.
    NO_NAMES = (b"esc\x1b[2Jape", b"new\nline", b"nul\0", b"\xFF\xFE", b"caf\xC3\xA9")

    def test_names_are_text_wherever_they_show(self):
        for raw, shown in self.NAMES.items():
            tag = new_epc()
            self.reader(raw).upload(tag)
            self.assertEqual(shown, self.running.events("tag.new", tag=tag)[0]["reader"])
            self.assertEqual(shown, self.running.query("--tag", tag, "--type", "tag.new")[0]["reader"])
            self.assertEqual(shown, self.running.reader_info(shown)["name"])
        listed = {each["name"] for each in self.running.ask("GET", "/api/v1/readers").json()["readers"]}
        self.assertLessEqual(set(self.NAMES.values()), listed)
        for arguments in (("reader", "list"), ("events", "query"), ("events", "export", "--format", "csv")):
            self.assert_done(done := self.running.cli(*arguments))
            self.assertRegex(done.out, r"^[^\x00-\x09\x0B-\x1F\x7F]*$")

    def test_names_that_could_do_harm_never_reach_anyone_as_they_are(self):
        for raw in self.NO_NAMES:
            reader = self.reader(raw)
            reader.tags(new_epc())
            reader.close()
        wait_for(lambda: self.running.listener()["connections"] == 1, "only the good reader is left")
        everything = self.running.log() + "".join(self.running.cli(*arguments).out for arguments in
                                                  (("reader", "list"), ("events", "query"), ("events", "export")))
        self.assertNotRegex(everything, r"[\x00-\x09\x0B-\x1F\x7F-\x9F]")

    def test_a_reader_without_a_name_is_refused(self):
        stranger = self.reader(b"")
        stranger.tags(new_epc())
        stranger.wait_for_the_end()


if __name__ == "__main__":
    unittest.main()
