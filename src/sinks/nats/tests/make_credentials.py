#!/usr/bin/env python3
"""Makes what a NATS server in operator mode needs, and a user's credentials, with openssl alone: DIR/operator.conf and
DIR/user.creds. The tool that does this otherwise (nsc) is no Debian package. Usage: make_credentials.py DIR"""

import base64
import json
import subprocess
import sys
from pathlib import Path

# The first byte of a key as text, and of a seed (NATS documents "nkeys").
KINDS = {"operator": 14 << 3, "account": 0, "user": 20 << 3}
SEED = 18 << 3
ED25519_PRIVATE = bytes.fromhex("302e020100300506032b657004220420")  # PKCS #8 before the 32 bytes of the key
UNLIMITED = dict.fromkeys(("subs", "data", "payload", "imports", "exports", "conn", "leaf"), -1)
JETSTREAM = dict.fromkeys(("mem_storage", "disk_storage", "streams", "consumer"), -1)


def openssl(*arguments, stdin=b""):
    return subprocess.run(["/usr/bin/openssl", *arguments], input=stdin, capture_output=True, check=True).stdout


def crc16(data):
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def as_text(raw):
    return base64.b32encode(raw + crc16(raw).to_bytes(2, "little")).decode().rstrip("=")


def url64(data):
    return base64.urlsafe_b64encode(data).decode().rstrip("=")


class Key:
    def __init__(self, kind, folder, name):
        self.private = openssl("genpkey", "-algorithm", "ed25519", "-outform", "DER")
        self.file = folder / f"{name}.der"
        self.file.write_bytes(self.private)
        public = openssl("pkey", "-inform", "DER", "-in", str(self.file), "-pubout", "-outform", "DER")[-32:]
        self.public = as_text(bytes([KINDS[kind]]) + public)
        self.seed = as_text(bytes([SEED | KINDS[kind] >> 5, (KINDS[kind] & 31) << 3]) + self.private[-32:])

    def sign(self, subject, name, claims):
        """A JSON web token about `subject`, signed by us."""
        body = {"jti": name, "iat": 1700000000, "iss": self.public, "name": name, "sub": subject.public, "nats": claims}
        text = ".".join(
            url64(json.dumps(part).encode()) for part in ({"typ": "JWT", "alg": "ed25519-nkey"}, body)
        )
        message = self.file.with_suffix(".message")
        message.write_text(text)
        signature = openssl("pkeyutl", "-sign", "-rawin", "-in", str(message), "-inkey", str(self.file), "-keyform", "DER")
        return f"{text}.{url64(signature)}"


def main(arguments):
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(arguments[1])
    operator, system, plant, user = (
        Key(kind, folder, name)
        for kind, name in (("operator", "operator"), ("account", "system"), ("account", "plant"), ("user", "gantry"))
    )
    accounts = {
        key.public: operator.sign(key, name, {"type": "account", "version": 2, "limits": {**UNLIMITED, **limits}})
        for key, name, limits in ((system, "system", {}), (plant, "plant", {**JETSTREAM, "wildcards": True}))
    }
    lines = [
        f'operator: "{operator.sign(operator, "operator", {"type": "operator", "version": 2})}"',
        f"system_account: {system.public}",
        "resolver: MEMORY",
        "resolver_preload: {",
        *(f'  {public}: "{token}"' for public, token in accounts.items()),
        "}",
    ]
    (folder / "operator.conf").write_text("\n".join(lines) + "\n")
    rights = {"type": "user", "version": 2, "pub": {}, "sub": {}, "subs": -1, "data": -1, "payload": -1}
    parts = [
        ("NATS USER JWT", plant.sign(user, "gantry", rights)),
        ("USER NKEY SEED", user.seed),
    ]
    text = "\n".join(f"-----BEGIN {what}-----\n{value}\n------END {what}------\n" for what, value in parts)
    (folder / "user.creds").write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
