"""An LCM log with Drake's own message types."""

from pathlib import Path

from drake import lcmt_drake_signal, lcmt_force_torque, lcmt_iiwa_status


def lcm_event(number: int, microseconds: int, channel: bytes, data: bytes) -> bytes:
    head = b"\xed\xa1\xda\x01" + number.to_bytes(8, "big") + microseconds.to_bytes(8, "big")
    return head + len(channel).to_bytes(4, "big") + len(data).to_bytes(4, "big") + channel + data


def write_lcm(path: Path, samples: int = 5) -> Path:
    events = []
    for i in range(samples):
        status = lcmt_iiwa_status()
        status.utime, status.num_joints = 1000 * i, 2
        for name in status.__slots__[2:]:
            setattr(status, name, [float(i), -float(i)])
        force = lcmt_force_torque()
        force.timestamp, force.fz = i, 9.0 + i
        signal = lcmt_drake_signal()
        signal.dim, signal.val, signal.coord, signal.timestamp = 2, [0.5, 0.25], ["u.a", "speed"], i
        sent = {b"IIWA_STATUS": status, b"FT": force, b"SIGNAL": signal}
        events += [(i * 1000 + 10, channel, message.encode()) for channel, message in sent.items()]
        events.append((i * 1000 + 20, b"OTHER", b"12345678 not Drake's"))
    path.write_bytes(b"".join(lcm_event(n, *event) for n, event in enumerate(events)))
    return path
