"""Who may dial in: names and addresses outside the configuration are refused, and everyone else runs on."""

import unittest

from gantry_e2e import READER, EndToEnd, run, wait_for
from silion import SilionReader, new_epc


class Admission(EndToEnd):
    def reader(self, gateway, name="gate-1", **more):
        reader = SilionReader(gateway.port, name, **more)
        self.addCleanup(reader.close)
        return reader

    def refused(self, gateway, name, why, **more):
        stranger = self.reader(gateway, name, **more)
        stranger.tags(new_epc())
        stranger.wait_for_the_end()
        gateway.wait_for_message(rf'^{more.get("source", "127.0.0.1")}:\d+ calls itself "{name}" and is refused: {why}')

    def test_a_name_that_no_section_matches(self):
        gateway = self.gateway()
        reader = self.reader(gateway)
        reader.upload(new_epc())
        self.refused(gateway, "dock-1", "no .*section has that name or a pattern for it")
        reader.upload(new_epc())
        self.assertEqual(["gate-1"], [row["reader"] for row in gateway.events("reader.connected")])
        self.assertEqual(2, len(gateway.events("tag.new")))
        self.assertEqual(1, gateway.listener()["refused"])

    def test_an_address_outside_from(self):
        gateway = self.gateway(READER + 'from = ["127.0.0.1/32"]\n')
        reader = self.reader(gateway)
        reader.upload(new_epc())
        self.refused(gateway, "gate-2", "its address 127.0.0.2 is outside", source="127.0.0.2")
        reader.upload(new_epc())

    def test_an_outsider_cannot_displace_who_is_inside(self):
        gateway = self.gateway(READER + 'from = ["127.0.0.0/31"]\n')
        reader = self.reader(gateway)
        reader.upload(new_epc())
        self.refused(gateway, "gate-1", "its address 127.0.0.2 is outside", source="127.0.0.2")
        reader.upload(new_epc())
        self.assertEqual([], gateway.events("reader.disconnected"))

    def test_each_section_of_a_port_has_its_own_networks(self):
        gateway = self.gateway()
        gateway.stop()
        port = gateway.port  # a port of the system's choice, now for two sections
        gateway.toml = f"""
[[reader]]
name = "gate-*"
address = "silion-listen://127.0.0.1:{port}"
from = ["127.0.0.1"]
zone = "gate"
[[reader]]
name = "dock-*"
address = "silion-listen://127.0.0.1:{port}"
from = ["127.0.0.2"]
zone = "dock"
"""
        gateway.start()
        self.assertEqual([port], gateway.ports)
        for name, source, zone in (("gate-1", "127.0.0.1", "gate"), ("dock-1", "127.0.0.2", "dock")):
            tag = new_epc()
            self.reader(gateway, name, source=source).upload(tag)
            self.assertEqual(zone, gateway.events("tag.new", tag=tag)[0]["zone"])
        self.refused(gateway, "gate-2", "its address 127.0.0.2 is outside", source="127.0.0.2")
        self.refused(gateway, "dock-2", "its address 127.0.0.1 is outside", source="127.0.0.1")

    def test_sections_of_one_port_must_agree_on_the_makes_settings(self):
        gateway = self.gateway()
        gateway.stop()
        one = READER.replace(":0", f":{gateway.port}")
        gateway.toml = one + one.replace("gate-*", "dock-*").replace('"60s"', '"1s"')
        self.assert_refused(run("run", "-c", gateway.write_config()), "gate-*", "dock-*", "different settings")

    def test_an_exact_name_goes_before_a_pattern(self):
        gateway = self.gateway()
        gateway.stop()
        one = READER.replace(":0", f":{gateway.port}")
        gateway.toml = one + one.replace("gate-*", "gate-7").replace('"gate"', '"seventh"')
        gateway.start()
        zones = {}
        for name in ("gate-6", "gate-7"):
            tag = new_epc()
            self.reader(gateway, name).upload(tag)
            zones[name] = gateway.events("tag.new", tag=tag)[0]["zone"]
        self.assertEqual({"gate-6": "gate", "gate-7": "seventh"}, zones)

    def test_a_reader_of_one_port_is_refused_at_another(self):
        gateway = self.gateway(READER + READER.replace("gate-", "dock-"))
        self.refused(gateway, "dock-1", "no .*section has that name")

    def test_a_reader_that_changes_its_name_is_let_go(self):
        gateway = self.gateway()
        reader = self.reader(gateway)
        reader.upload(new_epc())
        reader.name = "gate-2"
        reader.tags(new_epc())
        reader.wait_for_the_end()
        down = gateway.wait_for_events(1, "reader.disconnected")[0]
        self.assertEqual(("gate-1", 'the reader changed its name from "gate-1" to "gate-2"'), (down["reader"], down["reason"]))
        self.assertEqual(1, len(gateway.events("tag.new")))

    def test_refused_ones_leave_no_connection_behind(self):
        gateway = self.gateway()
        before = gateway.process.open_files()
        for i in range(50):
            self.refused(gateway, f"stranger-{i}", "no .*section")
        wait_for(lambda: gateway.listener()["connections"] == 0, "all are gone")
        wait_for(lambda: gateway.process.open_files() <= before, "their files are closed")
        self.assertEqual(50, gateway.listener()["refused"])


if __name__ == "__main__":
    unittest.main()
