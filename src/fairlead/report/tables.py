"""Tables as data, rendered as Markdown here and as HTML by the page's template."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fairlead.core.budget import Budget
from fairlead.core.records import ActionOutcome
from fairlead.report.paper import RESULTS

Summary = Mapping[str, Any]


@dataclass(frozen=True)
class Table:
    """A table of texts. The first column names the row; `quiet` rows (the paper's) are shown muted."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    quiet: frozenset[int] = frozenset()

    def markdown(self) -> str:
        """The table in GitHub's Markdown, under its title."""
        align = ["---", *["---:"] * (len(self.columns) - 1)]
        lines = [self.columns, align, *self.rows]
        body = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
        return f"**{self.title}**\n\n{body}\n" + (f"\n{self.note}\n" if self.note else "")


def percent(value: float) -> str:
    """A rate in percent."""
    return f"{100 * value:.0f} %"


def rate(interval: Mapping[str, float]) -> str:
    """A rate with its interval, in percent."""
    return f"{percent(interval['value'])} [{100 * interval['low']:.0f}, {100 * interval['high']:.0f}]"


def counted(number: int, noun: str) -> str:
    """A number and its noun, in the plural where it is one."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _difference(interval: Mapping[str, float] | None, scale: float, digits: int) -> str:
    if interval is None:
        return "-"
    low, value, high = (scale * interval[key] for key in ("low", "value", "high"))
    if low == high:
        return f"{value:+.{digits}f}"
    return f"{value:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}]"


def _p_value(p: float | None) -> str:
    if p is None:
        return "-"
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _most(summary: Summary) -> int:
    """How many trials a method has that was tried on the whole set."""
    return max(entry["trials"] for entry in summary["methods"].values())


def whole(summary: Summary) -> dict[str, Summary]:
    """The methods that were tried on the whole set, with their numbers."""
    most = _most(summary)
    return {name: entry for name, entry in summary["methods"].items() if entry["trials"] == most}


def named(summary: Summary, name: str) -> str:
    """A method's name, and how many trials it has where others of the set have more."""
    return among(name, summary["methods"][name]["trials"], _most(summary))


def among(name: str, trials: int, most: int) -> str:
    """A method's name, and how many trials it has where that is not the most."""
    return name if trials == most else f"{name} (only {trials} of {most} trials)"


def overview_table(summaries: Mapping[str, Summary]) -> Table:
    """Success and mean error of every method in each set of trials, and the means of these over sets of one budget."""
    names = list(dict.fromkeys(name for summary in summaries.values() for name in summary["order"]))
    rows = []
    for title, summary in summaries.items():
        found, reference = whole(summary), summary.get("reference", summary["order"][0])
        cells = [_outcome(found[name]["success"]["value"], found[name]["error_m"]["mean"]) if name in found else "-"
                 for name in names]  # fmt: skip
        recovered = summary["methods"][reference]["recovery_actions"]
        rows.append((title, str(_most(summary)), *cells, f"{recovered} ({reference})"))
    mean = means(summaries)
    columns = ("trials of", "scenes and seeds", *names, "recovery actions")
    note = (
        "Success and mean final error of methods that were tried on the whole set. "
        "Recovery actions: those of the reference, in all."
    )
    if mean:
        rows.append(("mean", "", *(mean.get(name, "-") for name in names), ""))
    return Table("Overview", columns, tuple(rows), note)


def means(summaries: Mapping[str, Summary]) -> dict[str, str]:
    """Mean success and error of each method that was tried on the whole of every set with the same budget."""
    found, text = [whole(summary) for summary in summaries.values()], {}
    for name in found[0]:
        entries = [methods[name] for methods in found if name in methods]
        if len(entries) == len(found) and len({entry["budget"] for entry in entries}) == 1:
            success, error_m = (
                sum(values) / len(entries)
                for values in zip(*((e["success"]["value"], e["error_m"]["mean"]) for e in entries), strict=True)
            )
            text[name] = _outcome(success, error_m)
    return text


def _outcome(success: float, error_m: float) -> str:
    return f"{percent(success)}, {error_m:.3f} m"


def success_table(summary: Summary, budget: str) -> Table:
    """Success at the end, after the first plan alone, and earlier; another budget than `budget` is named."""
    methods = summary["methods"]
    limit = Budget.parse(budget).seconds
    known = {time for entry in methods.values() for time in entry["success_at_s"]}
    times = sorted((time for time in known if float(time) <= limit), key=float)
    columns = ("method", "trials", "success", "first plan alone", *(f"at {time} s" for time in times))
    rows = [
        (
            name if entry["budget"] == budget else f"{name} ({entry['budget']})",
            str(entry["trials"]),
            rate(entry["success"]),
            rate(entry["first_plan_success"]),
            *(percent(entry["success_at_s"][time]) if time in entry["success_at_s"] else "-" for time in times),
        )
        for name, entry in methods.items()
    ]
    note = (
        "Rates with 95 % Wilson intervals. First plan alone: executed open loop, before any re-planning; "
        "a trial that recovery ended before any plan has none, and counts as one whose first plan failed. "
        "When the budget ends, an action under way is finished and its end counts; what was under way earlier, at "
        "15 s of a minute, say, does not count there yet."
    )
    return Table("Success", columns, tuple(rows), note)


def error_table(summary: Summary, scenario: str) -> Table:
    """The paper's Table 1 (dragging) or Table 2 (dual arm), with the paper's own rows beneath."""
    rows: list[tuple[str, ...]] = []
    for name, entry in summary["methods"].items():
        values = [entry["error_m"][key] for key in ("min", "max", "mean", "median", "sd")]
        rows.append((named(summary, name), percent(entry["success"]["value"]), *map(_metres, values)))
    ours = len(rows)
    rows += [
        (f"paper: {paper.name}", percent(paper.success), *map(_metres, paper.error_m))
        for paper in RESULTS.get(scenario, ())
    ]
    columns = ("method", "success", "min [m]", "max [m]", "mean [m]", "median [m]", "SD [m]")
    note = (
        "The paper's rows are its published numbers: 180 s a trial, in its own simulator." if len(rows) > ours else ""
    )
    return Table("Final task error", columns, tuple(rows), note, frozenset(range(ours, len(rows))))


def comparison_table(summary: Summary) -> Table:
    """The reference method against every other one."""
    rows = [
        (
            f"{item['method']} vs {item['baseline']}",
            str(item["pairs"]),
            _difference(item.get("success_difference"), 100, 0),
            _p_value(item.get("mcnemar_p")),
            _p_value(item.get("first_plan_mcnemar_p")),
            _difference(item.get("error_difference_m"), 1, 3),
            _p_value(item["welch_p"]),
        )
        for item in summary["comparisons"]
    ]
    columns = ("pair", "trials", "success [points]", "McNemar P", "first plans P", "error [m]", "t-test P")
    note = (
        "Differences on the same scenes and seeds, with 95 % intervals from a bootstrap over scenes, where "
        "these differ. McNemar: exact, "
        "one-sided, of first plans too. t-test: the paper's, one-sided on the final error, unpaired (Welch). For tests "
        "and for intervals of rates a scene counts once, with the mean of its seeds."
    )
    if because := summary.get("reference_because"):
        note = f"{summary['reference']} is the reference: {because}. {note}"
    return Table("Paired comparison", columns, tuple(rows), note)


def effort_table(summary: Summary) -> Table:
    """What a trial of each method took on average, and how often it was stuck."""
    columns = (
        "method",
        "plans",
        "actions",
        "extensions",
        "planning [s]",
        "execution [s]",
        "stuck trials",
        "recoveries",
    )
    rows = [
        (
            named(summary, name),
            f"{entry['mean_plans']:.1f}",
            f"{entry['mean_actions']:.1f}",
            f"{entry['mean_extensions']:,.0f}",
            f"{entry['mean_planning_s']:.2f}",
            f"{entry['mean_execution_s']:.1f}",
            f"{entry['stuck_trials']} of {entry['trials']}",
            str(entry["recovery_actions"]),
        )
        for name, entry in summary["methods"].items()
    ]
    return Table("Effort", columns, tuple(rows), "Means over trials; stuck trials and recoveries are counts.")


def actions_table(summary: Summary) -> Table:
    """How the executed actions of each method ended, recovery included: the share of each reason."""
    ends = {name: entry.get("action_outcomes", {}) for name, entry in summary["methods"].items()}
    seen = [outcome for outcome in ActionOutcome if any(outcome.label in counts for counts in ends.values())]
    rows = []
    for name, counts in ends.items():
        total = sum(counts.values())
        shares = [f"{100 * counts.get(end.label, 0) / total:.1f} %" if total else "-" for end in seen]
        rows.append((named(summary, name), f"{total:,}", *shares))
    columns = ("method", "actions", *(end.label.replace("_", " ") for end in seen))
    return Table("How actions ended", columns, tuple(rows), " ".join(end.sentence for end in seen))


def metrics_table(title: str, metrics: Mapping[str, Mapping[str, float]], order: Sequence[str] = ()) -> Table:
    """Numbers of several models, one row a model; `order` names the columns to show, else all that any model has."""
    keys = list(order) or sorted({key for values in metrics.values() for key in values})
    rows = [(name, *(f"{v[key]:.4g}" if key in v else "-" for key in keys)) for name, v in metrics.items()]
    return Table(title, ("model", *(key.replace("_", " ") for key in keys)), tuple(rows))
