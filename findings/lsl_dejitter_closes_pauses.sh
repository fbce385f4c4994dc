#!/bin/sh
# Lab Streaming Layer: post-processing by proc_ALL closes a pause of a regular stream.
#
# Versions: pylsl 1.18.6 with the liblsl 1.18 of its wheel.
# Input:    a stream of nominally 500 Hz. Its source pauses for 2 s and goes on, as amplifiers do
#           whose wireless link drops out. Each chunk is pushed with the exact time of its last
#           sample, on the same computer, so that there is no jitter to be removed.
# Expected: the stamps that the inlet returns with proc_ALL (clocksync, dejitter, monotonize,
#           threadsafe) are those that were pushed, with a step of 2 s at the pause.
# Seen:     dejitter takes the pause for jitter. The first stamps after it are about 1.95 s too
#           early, so that the pause is gone; two seconds later they are about 0.5 s too late.
#           With clocksync and monotonize alone all stamps are right.
# The script fails if that changes. It takes half a minute.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --disable-pip-version-check install --quiet pylsl==1.18.6
printf '[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n' >"$folder/lsl_api.cfg"
LSLAPICFG="$folder/lsl_api.cfg" "$folder/venv/bin/python" - <<'PYTHON'
import threading
import time

import pylsl

RATE_HZ, CHUNK, COUNT, PAUSE_S = 500.0, 10, 2000, 2.0


def measure(flags):
    """Return how late the stamps are, in s: just before the pause, just after it, at the end."""
    name = f"film-{flags}"
    info = pylsl.StreamInfo(name, "Film", 1, RATE_HZ, "double64", name)
    outlet = pylsl.StreamOutlet(info)
    [source] = pylsl.resolve_byprop("name", name, timeout=10.0)
    inlet = pylsl.StreamInlet(source, processing_flags=flags)
    inlet.open_stream(timeout=10.0)
    begin_s = pylsl.local_clock()
    pushed = [begin_s + i / RATE_HZ + PAUSE_S * (i >= COUNT // 2) for i in range(COUNT)]

    def send():
        for i in range(0, COUNT, CHUNK):
            last_s = pushed[i + CHUNK - 1]
            while pylsl.local_clock() < last_s:
                time.sleep(0.001)
            outlet.push_chunk([[float(j)] for j in range(i, i + CHUNK)], last_s)

    thread = threading.Thread(target=send)
    thread.start()
    late_s = []
    while len(late_s) < COUNT:
        sample, stamp = inlet.pull_sample(timeout=10.0)
        late_s.append(stamp - pushed[int(sample[0])])
    thread.join()
    return late_s[COUNT // 2 - 1], late_s[COUNT // 2], late_s[-1]


print("pylsl", pylsl.__version__, "liblsl", pylsl.library_version())
everything = measure(pylsl.proc_ALL)
print("proc_ALL:                 before %+.3f s, after %+.3f s, end %+.3f s" % everything)
without = measure(pylsl.proc_clocksync | pylsl.proc_monotonize)
print("clocksync and monotonize: before %+.3f s, after %+.3f s, end %+.3f s" % without)
assert abs(everything[0]) < 0.01, "stamps before the pause are wrong"
assert everything[1] < -0.9 * PAUSE_S, "the pause is kept: the behaviour has changed"
assert everything[2] > 0.2, "the stamps are right again 2 s later: the behaviour has changed"
assert max(map(abs, without)) < 0.01, "stamps are wrong without dejitter, too"
PYTHON
