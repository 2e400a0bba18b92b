"""Judges answers. An answer is exact, or a documented error in time; all else is a finding.

verdict       meaning
exact         all bytes are those of the reference
partial       shards are missing, the answer says so, and all bytes are those of the reference without them
error         a documented code, a message that says something, in time, while there is a fault to blame
altered       plaintext only: OK with other bytes, while bits flipped on the way; docs/lab/robustness.md
garbled       plaintext only: an error that the method does not have, while bits flipped on the way
wrong         another picture                                                               a finding
undocumented  a code that the method's comment does not have, or has for bugs; no message   a finding
unexplained   an error without a fault                                                      a finding
hung          later than the deadline and a second                                          a finding
"""

import dataclasses
import threading

FINDINGS = ("wrong", "undocumented", "unexplained", "hung")
VERDICTS = ("exact", "partial", "error", "altered", "garbled") + FINDINGS
# How long a fault is to blame after its end: connections are dialled again, agents are asked again.
AFTERMATH_S = 4.0
GRACE_S = 1.0


@dataclasses.dataclass
class Answer:
    """A client's observation of one request. Times are those of time.monotonic(), seconds."""

    request: str  # its name in the pool
    method: str
    coordinator: str
    begin: float
    end: float
    limit_s: float  # the deadline that holds for it
    code: str  # "OK" or the name of gRPC's code
    message: str = ""
    digest: str = ""
    missing: tuple = ()
    request_id: str = ""
    is_direct: bool = False  # not through the client's link
    verdict: str = ""
    reason: str = ""
    blamed: frozenset = frozenset()  # kinds of the faults around it

    @property
    def took_s(self):
        return self.end - self.begin


@dataclasses.dataclass
class Episode:
    """A fault that was carried out: from `begin` until `end`, None while it lasts."""

    kind: str
    target: str
    begin: float
    end: float | None = None
    note: str = ""


class Episodes:
    """All that went wrong so far, and stalls of the machine itself. Thread-safe."""

    def __init__(self):
        self._lock = threading.Lock()
        self._all = []
        self._stalls = []  # (begin, end)

    def begin(self, kind, target, now):
        episode = Episode(kind, target, now)
        with self._lock:
            self._all.append(episode)
        return episode

    def end(self, episode, now):
        with self._lock:
            episode.end = now

    def stall(self, begin, end):
        with self._lock:
            self._stalls.append((begin, end))

    def during(self, begin, end):
        """Those that overlap [begin - AFTERMATH_S, end]."""
        with self._lock:
            # They begin in order; faults last seconds, so what began a minute ago is over.
            recent = []
            for episode in reversed(self._all):
                if episode.begin <= end and (episode.end is None or episode.end >= begin - AFTERMATH_S):
                    recent.append(episode)
                if episode.begin < begin - 60:
                    break
            return recent

    def stalled_s(self, begin, end):
        """How long the harness itself got no processor in that time."""
        with self._lock:
            return sum(max(0.0, min(end, b) - max(begin, a)) for a, b in self._stalls[-1000:])

    def stopped_s(self, target, begin, end):
        """How long a process was stopped in that time."""
        with self._lock:
            return sum(
                max(0.0, min(end, e.end if e.end is not None else end) - max(begin, e.begin))
                for e in self._all[-200:]
                if e.kind.startswith("stop_") and e.target == target
            )

    def stalls(self):
        with self._lock:
            return list(self._stalls)


# gRPC itself says so of a connection that broke on a damaged record, and of a call that came while a server shut down:
# no server of ours did (docs/lab/robustness.md).
_WORDS_OF_GRPC = {("UNKNOWN", "Stream removed"), ("CANCELLED", "CANCELLED")}


def _alters_client_link(answer, episode):
    """Whether the answer itself, or its request, may have come with other bits."""
    return episode.kind == "corrupt_client_link" and not answer.is_direct and episode.target == f"client>{answer.coordinator}"


def _alters_agent_link(answer, episode):
    """Whether a status of gRPC may have. The messages between coordinators and agents have checksums."""
    return episode.kind == "corrupt_agent_link" and episode.target.startswith(f"{answer.coordinator}>")


def _breaks_client(answer, episode):
    return episode.target in (answer.coordinator, f"client>{answer.coordinator}")


class Judge:
    """Judges answers against references. Thread-safe after construction.

    references: {(request, missing shards): digest}
    documented: {method: codes}
    is_plaintext: whether bits on the way are anybody's
    """

    def __init__(self, references, documented, episodes, is_plaintext):
        self._references = references
        self._documented = documented
        self._episodes = episodes
        self._is_plaintext = is_plaintext

    def judge(self, answer):
        """Sets verdict and reason, and returns the verdict."""
        blamed = self._episodes.during(answer.begin, answer.end)
        answer.blamed = frozenset(episode.kind for episode in blamed)
        answer.verdict, answer.reason = self._verdict(answer, blamed)
        # A late answer is a finding whatever it says, a wrong one even more so.
        if answer.verdict != "wrong" and (late := self._late(answer)):
            answer.verdict, answer.reason = "hung", late
        return answer.verdict

    def _verdict(self, answer, blamed):
        altered = self._is_plaintext and any(_alters_client_link(answer, episode) for episode in blamed)
        garbled = altered or self._is_plaintext and any(_alters_agent_link(answer, episode) for episode in blamed)
        if answer.code == "OK":
            expected = self._references.get((answer.request, tuple(answer.missing)))
            if expected == answer.digest:
                return ("partial", "") if answer.missing else ("exact", "")
            what = f"digest {answer.digest[:16]}, expected {(expected or 'none')[:16]}, missing {answer.missing}"
            return ("altered" if altered else "wrong"), what
        strange = self._strange(answer, blamed)
        if strange:
            return ("garbled" if garbled else "undocumented"), strange
        if not blamed:
            return "unexplained", f"{answer.code} without a fault: {answer.message}"
        return "error", ""

    def _strange(self, answer, blamed):
        if (answer.code, answer.message) in _WORDS_OF_GRPC and any(_breaks_client(answer, e) for e in blamed):
            return ""
        if answer.code not in self._documented.get(answer.method, set()):
            return f"{answer.code} is not in the table of {answer.method}: {answer.message}"
        if len(answer.message.strip()) < 8 or answer.message.strip().lower().startswith("unknown"):
            return f"{answer.code} with a message that names nothing: {answer.message!r}"
        if answer.code == "DATA_LOSS" and not any(e.kind.startswith(("flip_", "corrupt_")) for e in blamed):
            return f"DATA_LOSS, but nothing was damaged: {answer.message}"
        return ""

    def _late(self, answer):
        allowance = answer.limit_s + GRACE_S + self._episodes.stalled_s(answer.begin, answer.end)
        if answer.is_direct:
            # The deadline is the server's own, and its clock does not matter while it is stopped.
            allowance += self._episodes.stopped_s(answer.coordinator, answer.begin, answer.end)
        if answer.took_s <= allowance:
            return ""
        return f"{answer.code} after {answer.took_s:.2f} s; the deadline was {answer.limit_s:.2f} s: {answer.message}"
