"""The main path: a reader dials in, tags come and go, and what is stored says so."""

import json
import re
import time
import unittest
from datetime import datetime

from gantry_e2e import EVERY_READ, READER, EndToEnd, wait_for
from silion import FIRST_SEEN, SilionReader, Tag, new_epc, tag_data

QUICK = '[presence]\nlose_after = "600ms"\n'
PATIENT = '[presence]\nlose_after = "1h"\n'
SGTIN = "3074257BF7194E4000001A85"  # (01)80614141123458(21)6789
TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z")


def types(rows):
    return [row["type"] for row in rows]


def moment(text):
    return datetime.fromisoformat(text.replace("Z", "+00:00"))


class Presence(EndToEnd):
    def connected(self, gateway, name="gate-1", port=None):
        reader = SilionReader(port or gateway.port, name)
        self.addCleanup(reader.close)
        reader.heartbeat()
        return reader


class MainPath(Presence):
    def test_tags_come_and_go(self):
        gateway = self.gateway(READER + QUICK + EVERY_READ)
        reader = self.connected(gateway)
        tags = sorted(new_epc() for _ in range(3))
        reader.upload(*tags)
        self.assertEqual(tags, [row["tag"] for row in gateway.present()])
        for tag in tags:
            gateway.wait_for_events(1, "tag.lost", tag=tag)
            self.assertEqual(["tag.read", "tag.new", "tag.observed", "tag.lost"], types(gateway.events(tag=tag)))
        self.assertEqual([], gateway.present())
        lost = gateway.events("tag.lost")[0]
        gone_for = (moment(lost["time"]) - moment(lost["last_seen"])).total_seconds()
        self.assertAlmostEqual(0.6, gone_for, delta=0.01)

    def test_an_event_says_all_that_the_reader_said_and_no_more(self):
        gateway = self.gateway(READER + PATIENT + EVERY_READ)
        reader = self.connected(gateway)
        before = time.time()
        reader.upload(Tag(SGTIN, antenna=2, reads=17, rssi=-52))
        new, observed, read = (gateway.wait_for_events(1, kind)[0] for kind in ("tag.new", "tag.observed", "tag.read"))
        common = {"schema": 1, "reader": "gate-1", "antenna": "Ant2", "zone": "gate", "technology": "epc-gen2",
                  "tag": SGTIN, "epc": "urn:epc:id:sgtin:0614141.812345.6789", "gs1": "(01)80614141123458(21)6789",
                  "link": "https://id.gs1.org/01/80614141123458/21/6789", "rssi_dbm": -52.0, "reads": 17,
                  "time": read["time"]}
        for row, seq in ((read, 2), (new, 3), (observed, 4)):
            expected = {**common, "type": row["type"], "seq": seq, "id": f"e2e:{seq}"}
            if row is not read:
                expected |= {"first_seen": read["time"], "last_seen": read["time"]}
            self.assertEqual(expected, row)
        self.assertRegex(read["time"], TIME)
        self.assertAlmostEqual(before, moment(read["time"]).timestamp(), delta=10)

    def test_the_view_of_present_tags_says_where_each_is(self):
        gateway = self.gateway(READER + PATIENT)
        reader = self.connected(gateway)
        reader.upload(Tag(SGTIN, antenna=3, reads=5, rssi=-61))
        row = gateway.present()[0]
        seen = row.pop("first_seen"), row.pop("last_seen")
        self.assertEqual({"tag": SGTIN, "epc": "urn:epc:id:sgtin:0614141.812345.6789", "zone": "gate", "reader": "gate-1",
                          "antenna": "Ant3", "reads": 5, "rssi_dbm": -61.0}, row)
        for each in seen:
            self.assertRegex(each, TIME)

    def test_view_and_command_line_tell_the_same(self):
        gateway = self.gateway(READER + QUICK + EVERY_READ)
        reader = self.connected(gateway)
        reader.upload(Tag(SGTIN), Tag(new_epc(), bank=b"\x01\x02\xFE"), Tag("E200", antenna=4, rssi=0, protocol=3))
        reader.inputs(1, 0, 0, 1)
        reader.fault(11)
        reader.inputs(1, 0, 1, 1)
        reader.reset()
        gateway.wait_for_events(1, "reader.disconnected")
        reader = self.connected(gateway)
        gateway.wait_for_events(3, "tag.lost")
        reader.heartbeat()
        rows = gateway.events()
        self.assertLessEqual({"tag.new", "tag.observed", "tag.lost", "tag.read", "reader.connected", "reader.fault",
                              "reader.disconnected", "gpi.changed"}, set(types(rows)))
        for row in rows:
            if "data" in row:
                row["data"] = json.loads(row["data"])
            if "state" in row:
                row["state"] = bool(row["state"])
        self.assertEqual(rows, gateway.query()[:len(rows)])

    def test_bank_data_come_with_the_read(self):
        gateway = self.gateway(READER + EVERY_READ)
        reader = self.connected(gateway)
        reader.upload(Tag(SGTIN, bank=bytes.fromhex("DEADBEEF")))
        self.assertEqual({"user": "DEADBEEF"}, json.loads(gateway.wait_for_events(1, "tag.read")[0]["data"]))

    def test_reads_are_no_events_unless_asked_for(self):
        gateway = self.gateway(READER + PATIENT)
        reader = self.connected(gateway)
        for _ in range(3):
            reader.upload(SGTIN)
            reader.heartbeat()
        self.assertEqual(["reader.connected", "tag.new", "tag.observed"], types(gateway.events()))
        wait_for(lambda: gateway.status()["reads"] == 3, "three reads counted")
        wait_for(lambda: gateway.present()[0]["reads"] == 3, "three reads in present_tags")

    def test_the_reader_and_its_inputs_and_faults_are_events(self):
        gateway = self.gateway()
        reader = self.connected(gateway)
        reader.inputs(0, 1, 0, 0)
        reader.inputs(0, 1, 1, 0)
        reader.fault(11)
        fault = gateway.wait_for_events(1, "reader.fault")[0]
        self.assertEqual((11, "alarm: no antennas connected"), (fault["code"], fault["text"]))
        changed = [(row["input"], row["state"]) for row in gateway.events("gpi.changed")]
        self.assertEqual([(1, 0), (2, 1), (3, 0), (4, 0), (3, 1)], changed)
        reader.close()
        gateway.wait_for_events(1, "reader.disconnected", reader="gate-1")

    def test_a_first_seen_frame_counts_like_any_other(self):
        gateway = self.gateway(READER + EVERY_READ)
        reader = self.connected(gateway)
        reader.send(reader.frame(FIRST_SEEN, tag_data([Tag(SGTIN)])))
        self.assertEqual(SGTIN, gateway.wait_for_events(1, "tag.observed")[0]["tag"])


class Zones(Presence):
    TWO_ZONES = """
[[reader.antenna]]
name = "Ant1"
zone = "in"
[[reader.antenna]]
name = "Ant2"
zone = "out"
"""

    def test_an_antenna_may_have_a_zone_of_its_own(self):
        gateway = self.gateway(READER + self.TWO_ZONES + PATIENT)
        reader = self.connected(gateway)
        tags = [new_epc() for _ in range(3)]
        reader.upload(*(Tag(tag, antenna=antenna) for antenna, tag in enumerate(tags, 1)))
        zones = {row["tag"]: row["zone"] for row in gateway.events("tag.new")}
        self.assertEqual(dict(zip(tags, ("in", "out", "gate"))), zones)

    def test_a_tag_that_goes_to_another_zone_has_moved(self):
        gateway = self.gateway(READER + self.TWO_ZONES + QUICK)
        reader = self.connected(gateway)
        reader.upload(Tag(SGTIN, antenna=1))
        reader.upload(Tag(SGTIN, antenna=2))
        moved = gateway.wait_for_events(1, "tag.moved")
        self.assertEqual([("in", "out", "out")], [(row["from"], row["to"], row["zone"]) for row in moved])
        gateway.wait_for_events(2, "tag.lost")
        self.assertEqual(["in", "out"], [row["zone"] for row in gateway.events("tag.lost")])

    def test_a_zone_may_have_rules_of_its_own(self):
        gateway = self.gateway(READER + self.TWO_ZONES + PATIENT + '[[zone]]\nname = "out"\nlose_after = "300ms"\n')
        reader = self.connected(gateway)
        tags = [new_epc(), new_epc()]
        reader.upload(Tag(tags[0], antenna=1), Tag(tags[1], antenna=2))
        gateway.wait_for_events(1, "tag.lost", tag=tags[1])
        self.assertEqual([tags[0]], [row["tag"] for row in gateway.present()])

    def test_two_readers_of_one_zone_see_one_presence(self):
        gateway = self.gateway(READER + PATIENT)
        for name in ("gate-1", "gate-2"):
            self.connected(gateway, name).upload(SGTIN)
        self.assertEqual(1, len(gateway.events("tag.new")))
        self.assertEqual(1, len(gateway.present()))


class Offline(Presence):
    TWO_READERS = READER + READER.replace("gate-*", "dock").replace('"gate"', '"dock"')

    def test_a_cut_cable_is_no_departure(self):
        gateway = self.gateway(self.TWO_READERS + QUICK)
        gate = self.connected(gateway)
        dock = self.connected(gateway, "dock", gateway.ports[1])
        gate.upload(SGTIN)
        gate.reset()
        gateway.wait_for_events(1, "reader.disconnected", reader="gate-1")
        # The same timer, begun later, runs out beside it: then it would have run out for the other, too.
        other = new_epc()
        dock.upload(other)
        gateway.wait_for_events(1, "tag.lost", tag=other)
        self.assertEqual([SGTIN], [row["tag"] for row in gateway.present()])
        # The reader is back: time goes on for the tag.
        gate = self.connected(gateway)
        gateway.wait_for_events(1, "tag.lost", tag=SGTIN)
        self.assertEqual(1, len(gateway.events("tag.new", tag=SGTIN)))

    def test_a_tag_that_stood_there_all_the_time_never_left(self):
        gateway = self.gateway(READER + PATIENT)
        reader = self.connected(gateway)
        reader.upload(SGTIN)
        reader.reset()
        gateway.wait_for_events(1, "reader.disconnected")
        reader = self.connected(gateway)
        reader.upload(SGTIN)
        self.assertEqual(["tag.new", "tag.observed"], types(gateway.events(tag=SGTIN)))
        self.assertEqual(1, len(gateway.present()))

    def test_offline_lose_after_gives_it_up(self):
        gateway = self.gateway(READER + '[presence]\nlose_after = "1h"\noffline_lose_after = "300ms"\n')
        reader = self.connected(gateway)
        reader.upload(SGTIN)
        reader.reset()
        self.assertEqual("reader_offline", gateway.wait_for_events(1, "tag.lost", tag=SGTIN)[0]["reason"])


class AfterARestart(Presence):
    def presence_lasts(self, again):
        gateway = self.gateway(READER + PATIENT)
        self.connected(gateway).upload(SGTIN)
        first = gateway.present()[0]["first_seen"]
        again(gateway)
        self.assertEqual([(SGTIN, first)], [(row["tag"], row["first_seen"]) for row in gateway.present()])
        self.connected(gateway).upload(Tag(SGTIN, reads=2))  # not the same bytes: a frame of its own
        self.assertEqual(["tag.new", "tag.observed"], types(gateway.events(tag=SGTIN)))
        self.assertEqual(1, gateway.status()["tags_present"])

    def test_who_was_present_still_is(self):
        self.presence_lasts(lambda gateway: gateway.restart())

    def test_who_was_present_still_is_when_it_was_killed(self):
        self.presence_lasts(lambda gateway: gateway.kill_and_restart())

    def test_timers_stand_still_until_the_reader_is_back(self):
        gateway = self.gateway(READER + '[presence]\nlose_after = "4s"\n')  # the kill must come before that
        self.connected(gateway).upload(SGTIN)
        gateway.kill_and_restart()
        other = new_epc()
        self.connected(gateway, "gate-2").upload(other)
        gateway.wait_for_events(1, "tag.lost", tag=other)
        self.assertEqual([], gateway.events("tag.lost", tag=SGTIN))
        self.connected(gateway)
        gateway.wait_for_events(1, "tag.lost", tag=SGTIN)
        self.assertEqual(1, len(gateway.events("tag.new", tag=SGTIN)))

    def test_who_was_lost_before_is_not_new_after(self):
        gateway = self.gateway(READER + QUICK)
        self.connected(gateway).upload(SGTIN)
        gateway.wait_for_events(1, "tag.lost", tag=SGTIN)
        gateway.kill_and_restart()
        self.connected(gateway).upload(Tag(SGTIN, reads=2))
        gateway.wait_for_events(2, "tag.observed", tag=SGTIN)
        self.assertEqual(1, len(gateway.events("tag.new", tag=SGTIN)))


class Rules(Presence):
    def test_observed_after_so_many_reads(self):
        gateway = self.gateway(READER + PATIENT + 'glimpse_timeout = "1h"\nobserve_after_reads = 3\n')
        reader = self.connected(gateway)
        reader.upload(SGTIN)
        self.assertEqual(["tag.new"], types(gateway.events(tag=SGTIN)))
        reader.upload(Tag(SGTIN, reads=2))
        self.assertEqual(["tag.new", "tag.observed"], types(gateway.events(tag=SGTIN)))

    def test_observed_after_a_while(self):
        gateway = self.gateway(READER + PATIENT + 'glimpse_timeout = "1h"\nobserve_after = "500ms"\n')
        reader = self.connected(gateway)

        def seen_again():
            reader.upload(SGTIN)
            reader.heartbeat()
            return gateway.events("tag.observed")
        observed = wait_for(seen_again, "the tag is observed")[0]
        new = gateway.events("tag.new")[0]
        self.assertGreaterEqual((moment(observed["time"]) - moment(new["time"])).total_seconds(), 0.5)

    def test_a_glimpse_is_purged(self):
        gateway = self.gateway(READER + '[presence]\nglimpse_timeout = "200ms"\nobserve_after_reads = 5\n')
        reader = self.connected(gateway)
        reader.upload(SGTIN)
        purged = gateway.wait_for_events(1, "tag.purged")[0]
        self.assertEqual("glimpse_timeout", purged["reason"])
        self.assertEqual(["tag.new", "tag.purged"], types(gateway.events(tag=SGTIN)))
        reader.upload(Tag(SGTIN, reads=2))
        gateway.wait_for_events(2, "tag.new", tag=SGTIN)

    def test_glimpses_are_events_when_asked_for(self):
        gateway = self.gateway(READER + PATIENT + "[events]\ntag_glimpsed = true\n")
        self.connected(gateway).upload(SGTIN)
        self.assertEqual(["tag.new", "tag.glimpsed", "tag.observed"], types(gateway.events(tag=SGTIN)))

    def test_back_within_purge_after_is_not_new(self):
        gateway = self.gateway(READER + QUICK)
        reader = self.connected(gateway)
        reader.upload(SGTIN)
        gateway.wait_for_events(1, "tag.lost")
        reader.heartbeat()
        reader.upload(SGTIN)
        self.assertEqual(["tag.new", "tag.observed", "tag.lost", "tag.observed"], types(gateway.events(tag=SGTIN)))

    def test_back_after_it_was_purged_is_new(self):
        gateway = self.gateway(READER + '[presence]\nlose_after = "200ms"\npurge_after = "200ms"\n')
        reader = self.connected(gateway)
        reader.upload(SGTIN)
        gateway.wait_for_events(1, "tag.purged")
        reader.heartbeat()
        reader.upload(SGTIN)
        self.assertEqual(["tag.new", "tag.observed", "tag.lost", "tag.purged", "tag.new", "tag.observed"],
                         types(gateway.events(tag=SGTIN))[:6])


if __name__ == "__main__":
    unittest.main()
