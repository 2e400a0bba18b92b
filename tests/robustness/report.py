"""Counts, and the table of a run: as text and as JSON."""

import collections
import dataclasses
import json
import re
import threading
import time

from robustness.model import FINDINGS, VERDICTS

MAX_FINDINGS = 200


class Report:
    """The observations of a run. Thread-safe."""

    def __init__(self):
        self._lock = threading.Lock()
        self._rows = collections.defaultdict(lambda: collections.Counter())  # by kind of fault
        self._errors = collections.defaultdict(collections.Counter)
        self._slowest = collections.defaultdict(float)
        self._verdicts = collections.Counter()
        self._codes = collections.Counter()
        self._messages = collections.Counter()
        self._methods = collections.Counter()
        self._faults = collections.Counter()
        self._notes = collections.Counter()
        self._facts = {}
        self._begin = time.monotonic()
        self.recovery_s = []
        self.findings = []
        self.finding_count = 0
        self.altered = []

    def add(self, answer):
        with self._lock:
            self._verdicts[answer.verdict] += 1
            self._codes[answer.code] += 1
            self._methods[answer.method] += 1
            if answer.code != "OK":
                way = "directly" if answer.is_direct else "through the proxy"
                words = re.sub(r"\b[0-9a-f]*[0-9][0-9a-f]*\b", "N", answer.message)[:160]
                self._messages[f"{answer.code} {way}: {words}"] += 1
            for kind in answer.blamed or {"no fault"}:
                row = self._rows[kind]
                row["answers"] += 1
                row[answer.verdict] += 1
                if answer.code != "OK":
                    self._errors[kind][answer.code] += 1
                self._slowest[kind] = max(self._slowest[kind], answer.took_s)
            self._slowest["all"] = max(self._slowest["all"], answer.took_s)
        if answer.verdict in FINDINGS:
            self.find(answer.verdict, f"{answer.request} ({answer.method}) from {answer.coordinator}"
                      f"{' directly' if answer.is_direct else ''}, id {answer.request_id or 'unknown'}, during "
                      f"{', '.join(sorted(answer.blamed)) or 'no fault'}: {answer.reason}")  # fmt: skip
        elif answer.verdict == "altered":
            with self._lock:
                self.altered.append(f"{answer.request} ({answer.method}): {answer.reason}")

    def find(self, kind, sentence):
        """A finding: a run with one fails."""
        with self._lock:
            self.finding_count += 1
            if len(self.findings) < MAX_FINDINGS:
                self.findings.append({"kind": kind, "at_s": round(time.monotonic() - self._begin, 2), "what": sentence})
                print(f"FINDING {kind}: {sentence}", flush=True)

    def add_fault(self, fault, episode):
        with self._lock:
            self._faults[fault.kind] += 1
            if episode.note:
                self._notes[f"{fault.kind}: {episode.note}"] += 1

    def add_facts(self, name, facts):
        with self._lock:
            kept = self._facts.setdefault(name, {})
            for key, value in facts.items():
                kept[key] = max(kept.get(key, 0), value)

    def totals(self):
        with self._lock:
            return {
                "faults": sum(self._faults.values()),
                "answers": sum(self._verdicts.values()),
                **{verdict: self._verdicts[verdict] for verdict in VERDICTS},
                "findings": self.finding_count,
                "slowest_s": round(self._slowest["all"], 3),
                "seconds": round(time.monotonic() - self._begin, 1),
            }

    def codes(self):
        """Returns the number of answers by code, as text."""
        with self._lock:
            return ", ".join(f"{code} {count}" for code, count in self._codes.most_common())

    def end_of_run(self):
        """Returns the values that may have changed while the cluster ended."""
        return {"totals": self.totals(), "findings": self.findings}

    def _table(self):
        rows = []
        for kind in sorted(set(self._rows) | set(self._faults)):
            row = self._rows[kind]
            rows.append({
                "fault": kind, "count": self._faults[kind], "answers": row["answers"],
                **{verdict: row[verdict] for verdict in VERDICTS},
                "errors": dict(self._errors[kind].most_common()), "slowest_s": round(self._slowest[kind], 2),
            })  # fmt: skip
        return rows

    def to_json(self, run, stalls, flipped):
        """Everything, for programs."""
        totals = self.totals()
        with self._lock:
            return {
                "run": run, "totals": totals, "codes": dict(self._codes.most_common()),
                "methods": dict(self._methods.most_common()), "faults": self._table(), "findings": self.findings,
                "altered": self.altered[:MAX_FINDINGS],
                "processes": self._facts, "slowest_recovery_s": round(max(self.recovery_s, default=0), 2),
                "stalls": len(stalls), "longest_stall_s": round(max((b - a for a, b in stalls), default=0), 2),
                "flipped_bits": flipped, "messages": dict(self._messages.most_common(60)), "notes": dict(self._notes.most_common(100)),
            }  # fmt: skip


def to_text(data):
    """Returns the table of the result of Report.to_json, as text."""
    counts = ("count", "answers", "exact", "partial", "altered", "garbled", "wrong", "hung")
    columns = ("fault", *counts, "other", "slowest", "errors")
    lines = []
    for row in data["faults"]:
        errors = ", ".join(f"{code} {count}" for code, count in row["errors"].items())
        other = row["undocumented"] + row["unexplained"]
        lines.append((row["fault"], *(row[name] for name in counts), other, f"{row['slowest_s']:.2f} s", errors))
    widths = [max(len(str(line[i])) for line in [columns, *lines]) for i in range(len(columns))]

    def row_text(line):
        cells = [str(cell).ljust(w) if i in (0, len(columns) - 1) else str(cell).rjust(w) for i, (cell, w) in
                 enumerate(zip(line, widths))]  # fmt: skip
        return "  ".join(cells).rstrip()

    totals, run = data["totals"], data["run"]
    wire = "TLS" if run["tls"] else "plaintext"
    text = [f"seed {run['seed']}, {run['topology']}, {wire}, {run['clients']} clients", ""]
    if run.get("agents"):
        agents = (f"{name} {draw['threads']}, {draw['limit_mib']} MiB" for name, draw in run["agents"].items())
        text.insert(1, f"agents (threads, memory limit): {'; '.join(agents)}")
    text += [row_text(columns)] + [row_text(line) for line in lines]
    text += [
        "",
        "An answer counts for every kind of fault around it. other: errors that are undocumented, or without a fault.",
        "",
        f"{totals['faults']} faults, {totals['answers']} answers in {totals['seconds']:.0f} s: "
        f"{totals['exact']} exact, {totals['partial']} partial, {totals['error']} documented errors, "
        f"{totals['altered']} altered, {totals['garbled']} garbled; "
        f"{totals['wrong']} wrong, {totals['hung']} hung, {totals['undocumented']} undocumented, "
        f"{totals['unexplained']} unexplained; {totals['findings']} findings",
        f"slowest answer {totals['slowest_s']} s, slowest recovery {data['slowest_recovery_s']} s, "
        f"{data['stalls']} stalls of this machine, the longest {data['longest_stall_s']} s, "
        f"{sum(data['flipped_bits'].values())} bits flipped on the way",
    ]
    for name, facts in sorted(data["processes"].items()):
        text.append(f"{name}: at most {facts.get('resident_bytes', 0) >> 20} MiB, {facts.get('threads', 0)} threads, "
                    f"{facts.get('descriptors', 0)} descriptors between storms")  # fmt: skip
    text += [f"note: {note} ({count})" for note, count in data["notes"].items() if "skipped" in note]
    text += [f"FINDING {finding['kind']} at {finding['at_s']} s: {finding['what']}" for finding in data["findings"]]
    return "\n".join(text) + "\n"


def write_json(path, data):
    with open(path, "w") as file:
        json.dump(data, file, indent=1, default=dataclasses.asdict)
        file.write("\n")
