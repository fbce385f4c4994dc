#!/bin/sh
# Lab Streaming Layer: pull_chunk does not return after its timeout once the source has ended.
#
# Versions: pylsl 1.18.6 with the liblsl 1.18 of its wheel.
# Input:    a source that sends 30 samples, waits for a second and ends, as every recording ends.
#           The inlet has received the samples but not yet pulled them. It is made with the default
#           arguments, so that it waits for the source to come back.
# Expected: pull_chunk(timeout=0.5) returns the 30 samples after half a second. So it does while the
#           source is still there, and so do calls of pull_sample(timeout=0.5), one by one, even
#           after the source has ended.
# Seen:     after the source has ended, pull_chunk has not returned after 15 s, and neither has
#           pull_chunk(timeout=0.0). The samples in the inlet's buffer are lost with the process.
# The script fails if that changes. It takes two minutes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" --disable-pip-version-check install --quiet pylsl==1.18.6
printf '[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n' >"$folder/lsl_api.cfg"

cat >"$folder/source.py" <<'PYTHON'
import time

import pylsl

outlet = pylsl.StreamOutlet(pylsl.StreamInfo("film", "Film", 1, 1000.0, "float32", "film"))
assert outlet.wait_for_consumers(20.0)
for i in range(30):
    outlet.push_sample([i])
time.sleep(1.0)
PYTHON

cat >"$folder/sink.py" <<'PYTHON'
import subprocess
import sys
import time

import pylsl

when, how, timeout = sys.argv[2], sys.argv[3], float(sys.argv[4])
source = subprocess.Popen([sys.executable, sys.argv[1]])
[found] = pylsl.resolve_byprop("name", "film", timeout=10.0)
inlet = pylsl.StreamInlet(found)
inlet.open_stream(timeout=10.0)
time.sleep(0.5)
if when == "after":
    source.wait()
    time.sleep(1.0)
begin = time.monotonic()
if how == "chunk":
    count = len(inlet.pull_chunk(timeout=timeout, max_samples=100)[1])
else:
    count = 0
    while inlet.pull_sample(timeout=timeout)[0] is not None:
        count += 1
print(f"{count} samples in {time.monotonic() - begin:.1f} s", flush=True)
PYTHON

export LSLAPICFG="$folder/lsl_api.cfg"
"$folder/venv/bin/python" -c 'import pylsl; print("pylsl", pylsl.__version__, "liblsl", pylsl.library_version())'

# pull WHEN HOW TIMEOUT EXPECTED: run the inlet for at most 20 s, and compare its answer
pull() {
    answer=$(timeout -s KILL 20 "$folder/venv/bin/python" "$folder/sink.py" "$folder/source.py" "$1" "$2" "$3") ||
        answer="no answer"
    echo "pull_$2(timeout=$3) $1 the end of the source: $answer"
    case $answer in
    "$4"*) ;;
    *)
        echo "expected: $4"
        exit 1
        ;;
    esac
}
pull before chunk 0.5 "30 samples"
pull after sample 0.5 "30 samples"
pull after chunk 0.5 "no answer"
pull after chunk 0.0 "no answer"
