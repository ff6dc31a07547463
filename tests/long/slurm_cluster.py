"""A real Slurm on this machine: munge, a controller without accounts, and two nodes, for the time of a test.

Debian has all of it: `apt-get install slurm-wlm munge`. It runs as the user who starts it; only root can start jobs.
"""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

NODES = ("n1", "n2")
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun")

CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobRequeue={requeue:d}
ReturnToService=2
SlurmdTimeout=10
KillWait=5
OverTimeLimit=0
SchedulerParameters=sched_interval=2,bf_interval=2,batch_sched_delay=1,requeue_delay=1
"""


def is_possible() -> bool:
    """All programs are there, and this user may start them."""
    path = os.pathsep.join([os.environ["PATH"], "/usr/sbin"])
    return os.getuid() == 0 and all(shutil.which(program, path=path) for program in PROGRAMS)


class Cluster:
    """What a test does to it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def states(self) -> dict[str, str]:
        """Number of each job of the last minutes -> its state."""
        asked = ["squeue", "--noheader", "--array", "--states=all", "--format=%i|%T"]
        lines = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.splitlines()
        return {number: state for number, _, state in (line.partition("|") for line in lines)}

    def node_of(self, job: str) -> str:
        asked = ["squeue", "--noheader", "--format=%N", "--job", job]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()

    def lose(self, node: str) -> None:
        """The node ends, with all that runs on it: first what would tell the controller of it."""
        asked = ["squeue", "--noheader", "--format=%A", "--nodelist", node]
        jobs = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()
        steps = [f"slurmstepd: [{job}." for job in jobs]
        self._kill(int((self.folder / f"slurmd.{node}.pid").read_text()))
        self._kill_all("cmdline", steps)
        self._kill_all("environ", [f"SLURMD_NODENAME={node}"])

    def start_node(self, node: str) -> None:
        (self.folder / f"spool.{node}").mkdir(exist_ok=True)
        subprocess.run(["slurmd", "-N", node], check=True)

    def _kill_all(self, file: str, texts: Sequence[str]) -> None:
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                said = (process / file).read_bytes()
                if any(text.encode() in said for text in texts):
                    self._kill(int(process.name))

    @staticmethod
    def _kill(process: int) -> None:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


@contextmanager
def cluster(folder: Path, *, requeue: bool = True) -> Iterator[Cluster]:
    """A cluster whose commands the environment of this process finds; all of it ends with the context."""
    before = {name: os.environ.get(name) for name in ("PATH", "SLURM_CONF")}
    os.environ["PATH"] = os.pathsep.join([os.environ["PATH"], "/usr/sbin"])
    os.environ["SLURM_CONF"] = str(_configure(folder, requeue))
    made = Cluster(folder)
    munge = _start_munge(folder / "munge")
    try:
        subprocess.run(["slurmctld"], check=True)
        for node in NODES:
            made.start_node(node)
        _wait_for_nodes()
        yield made
    finally:
        for file in folder.glob("*.pid"):
            with suppress(ValueError, OSError):
                Cluster._kill(int(file.read_text()))
        munge.kill()
        munge.wait()
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _configure(folder: Path, requeue: bool) -> Path:
    (folder / "state").mkdir(parents=True)
    ports = _free_ports(1 + len(NODES))
    text = CONFIGURATION.format(host=socket.gethostname(), port=ports[0], folder=folder, requeue=requeue)
    for node, port in zip(NODES, ports[1:], strict=True):
        host = socket.gethostname()
        text += f"NodeName={node} NodeAddr=127.0.0.1 NodeHostname={host} Port={port} CPUs=4 RealMemory=8000\n"
    text += f"PartitionName=main Nodes={','.join(NODES)} Default=YES MaxTime=INFINITE State=UP\n"
    file = folder / "slurm.conf"
    file.write_text(text)
    return file


def _free_ports(count: int) -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


def _start_munge(folder: Path) -> subprocess.Popen[bytes]:
    folder.mkdir(mode=0o700)
    key = folder / "key"
    key.write_bytes(secrets.token_bytes(128))
    key.chmod(0o600)
    files = [f"--{name}-file={folder / name}" for name in ("key", "pid", "log", "seed")]
    munge = subprocess.Popen(["munged", "--foreground", "--force", *files, f"--socket={folder / 'socket'}"])
    while not (folder / "socket").exists():
        assert munge.poll() is None, "munged ended"
        time.sleep(0.1)
    return munge


def _wait_for_nodes() -> None:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        said = subprocess.run(["sinfo", "--noheader", "--format=%T %D"], capture_output=True, text=True).stdout
        if said.split() == ["idle", str(len(NODES))]:
            return
        time.sleep(0.5)
    raise AssertionError(f"the nodes are not there after a minute: {said}")
