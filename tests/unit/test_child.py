"""Python in a process of its own: what it says, what it prints, how it is interrupted."""

from __future__ import annotations

import threading

from skelsplat.run.process import Child

SAYS = "sys.stderr.write('one\\ntwo\\n'); print(sys.stdin.read(), sys.argv[1:])"
WAITS = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    sys.stderr.write('ready\\n'); sys.stderr.flush()
    time.sleep(60)
except KeyboardInterrupt: print('whole'); sys.exit(130)
"""


def test_what_is_given_said_and_printed():
    heard = []
    status, printed = Child(SAYS, "a", "b", given=b"in", hear=heard.append).outcome()
    assert (status, printed, heard) == (0, "in ['a', 'b']\n", ["one", "two"])


def test_an_interruption_lets_it_finish_its_files():
    begun = threading.Event()
    child = Child("exec(sys.argv[1])", WAITS, hear=lambda _: begun.set())
    found = []
    waiting = threading.Thread(target=lambda: found.append(child.outcome()))
    waiting.start()
    assert begun.wait(30)
    child.interrupt()
    waiting.join(30)
    assert found == [(130, "whole\n")]
    child.interrupt()  # of one that has ended nothing comes


def test_an_interruption_reaches_what_it_has_started():
    begun, found = threading.Event(), []
    starts = "import subprocess; subprocess.call([sys.executable, '-c', 'import sys; ' + sys.argv[1]])"
    child = Child(starts, WAITS, hear=lambda _: begun.set(), alone=True)
    waiting = threading.Thread(target=lambda: found.append(child.outcome()))
    waiting.start()
    assert begun.wait(30)
    child.interrupt()
    waiting.join(30)  # what it has started has the same stdout
    assert found[0][1] == "whole\n"


def test_files_in_its_folder_are_not_imported(tmp_path):
    (tmp_path / "numpy.py").write_text("print('from the folder of a recording')", encoding="utf-8")
    status, printed = Child("import numpy; print(numpy.pi)", folder=tmp_path).outcome()
    assert (status, printed) == (0, "3.141592653589793\n")
