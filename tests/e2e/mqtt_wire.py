"""The bytes of MQTT that tests and proofs need to subscribe by themselves."""


def text(value):
    data = value.encode()
    return len(data).to_bytes(2, "big") + data


def packet(kind, body):
    size, out = len(body), bytearray([kind])
    while True:
        out.append(size % 128 | (128 if size > 127 else 0))
        size //= 128
        if not size:
            return bytes(out) + body
