"""A study: its runs are trained and scored; means, differences with intervals, tables, files."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError
from visaug.core.files import write_json, write_text
from visaug.core.progress import Progress
from visaug.core.wording import counted
from visaug_train import tables, training
from visaug_train.checks import Say, check_arms
from visaug_train.config import Config
from visaug_train.evaluate import Evaluation
from visaug_train.parallel import spread
from visaug_train.predictions import save_poses
from visaug_train.record import COMPARED
from visaug_train.statistics import holm, image_variance, paired_interval, paired_p_value
from visaug_train.strength import Strengths, strengths
from visaug_train.studies import hidden, target
from visaug_train.training import Run, Study, note_failure, prepare, start_network


@dataclass(frozen=True)
class ArmDifference:
    """An arm's mean over seeds less the baseline's, on one domain, with its 95 % interval.

    `p_value_in_family` is corrected for all differences of the study, by Holm's procedure.
    """

    arm: str
    domain: str
    measure: str
    reference: float
    difference: float
    low: float
    high: float
    p_value_in_family: float = float("nan")

    def __str__(self) -> str:
        return tables.signed(self.difference, self.low, self.high)

    @property
    def clear(self) -> bool:
        return self.low > 0 or self.high < 0

    @property
    def clear_in_family(self) -> bool:
        """Whether it is clear among all differences of the study."""
        return self.p_value_in_family < 0.05


@dataclass(frozen=True)
class Failure:
    """A run that did not end well."""

    arm: str
    seed: int
    error: str


@dataclass(frozen=True, eq=False)
class Ablation:
    """Finished runs and their scores.

    `scored` is (arm, seed) -> (run, domain -> evaluation) of the config's weights, `others` the summaries by domain of the
    same runs' other weights (best for last, last for best).
    """

    study: Study
    scored: Mapping[tuple[str, int], tuple[Run, Mapping[str, Evaluation]]]
    failures: tuple[Failure, ...]
    noise: Strengths | None = None
    others: Mapping[tuple[str, int], Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    # resampled scores, which cost most
    _known: dict[tuple, np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def config(self) -> Config:
        return self.study.config

    def seeds(self, arm: str) -> list[int]:
        return [seed for name, seed in self.scored if name == arm]

    @cached_property
    def summaries(self) -> dict[tuple[str, int], dict[str, dict[str, Any]]]:
        """(arm, seed) -> domain -> scores, as `visaug evaluate` gives them."""
        return {key: {d: e.summary() for d, e in each.items()} for key, (_, each) in self.scored.items()}

    def of_seeds(self, arm: str, domain: str, measure: str) -> list[float]:
        return [tables.value(self.summaries[arm, s][domain], measure) for s in self.seeds(arm)]

    @cached_property
    def means(self) -> tables.Scores:
        return self._over_seeds(self.summaries)

    @cached_property
    def spreads(self) -> tables.Scores:
        """The same, the seeds' standard deviation; arms with one seed have none."""
        return self._over_seeds(self.summaries, partial(np.std, ddof=1), 2)

    def _over_seeds(
        self, summaries: Mapping[tuple[str, int], Any], statistic: Callable = np.mean, least: int = 1
    ) -> tables.Scores:
        found: dict[str, dict[str, dict[str, float]]] = {}
        for arm in self.config.arms:
            runs = [summaries[arm, seed] for seed in self.seeds(arm) if (arm, seed) in summaries]
            if len(runs) >= least:
                found[arm] = {}
                for domain in self.study.tests:
                    values = {m: [tables.value(r[domain], m) for r in runs] for m in tables.MEASURES}
                    found[arm][domain] = {m: float(statistic(v)) for m, v in values.items()}
        return found

    @cached_property
    def differences(self) -> list[ArmDifference]:
        """Every arm against the baseline, paired by seed and image."""
        if not self.seeds(self.config.baseline):
            return []
        others = [arm for arm in self.means if arm != self.config.baseline]
        found = [
            ArmDifference(arm, domain, measure, *values)
            for arm in others
            for domain in self.study.tests
            for measure, values in self.compare((arm, domain), (self.config.baseline, domain)).items()
            if np.isfinite(values[1])  # a set without poses has no pose errors
        ]
        corrected = holm(np.array([d.p_value_in_family for d in found]))
        return [replace(d, p_value_in_family=float(p)) for d, p in zip(found, corrected)]

    @property
    def mixed(self) -> str:
        """What of versions and device differs between the runs; empty where nothing does."""
        several = []
        for key in COMPARED:
            found: dict[str, list[str]] = {}
            for (arm, seed), (run, _) in self.scored.items():
                found.setdefault(str(run.surroundings.get(key, "none")), []).append(f"{arm} seed {seed}")
            said = [f"{v} ({counted(len(runs), 'run')}, such as {runs[0]})" for v, runs in found.items()]
            several += [f"{key} {', '.join(said)}"] if len(found) > 1 else []
        return f"The runs were not trained alike: {'; '.join(several)}." if several else ""

    @cached_property
    def gains(self) -> list[target.ArmGain]:
        """Gains of the arms over the baseline, as shares of the oracle's gain; empty without an oracle."""
        return target.gains(self)

    @property
    def interval_covers(self) -> str:
        seeds = min((len(self.seeds(arm)) for arm in self.means), default=0)
        shared = ", all of which start from one shared network" if self.config.start else ""
        if seeds > 1:
            return (
                f"the intervals cover test images and {seeds} training seeds{shared}: paired differences, Student's t "
                "with Satterthwaite's degrees of freedom"
            )
        return (
            f"the intervals cover the choice of test images only{shared and ', and the training starts from one network'}"
            ": with one seed, how training varies is not in them"
        )

    def compare(
        self, own: tuple[str, str], other: tuple[str, str]
    ) -> dict[str, tuple[float, float, float, float, float]]:
        """One (arm, domain) less another, paired by seed and image: measure -> the other's mean over seeds, the
        difference, its 95 % interval and the p-value of no difference (see `visaug_train.statistics`).

        Domains of two cameras that took the same views are paired by view.
        """
        if not (seeds := [s for s in self.seeds(own[0]) if s in self.seeds(other[0])]):
            return {}
        reference, resampled = self.scores(other, seeds)
        scores, again = self.scores(own, seeds)
        differences, pairs = scores - reference, (again - resampled).mean(axis=1)
        by_images = image_variance(pairs)
        images = len(self.study.tests[own[1]])
        ends = paired_interval(differences, by_images, images)
        p_values = paired_p_value(differences, by_images, images)
        columns = np.array([reference.mean(axis=0), differences.mean(axis=0), *ends, p_values])
        return {measure: tuple(column) for measure, column in zip(tables.MEASURES, columns.T.tolist())}

    def scores(self, place: tuple[str, str], seeds: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """Scores of an (arm, domain), (seeds, measures), and on resampled images, (bootstrap, seeds, measures).

        The images that a resample holds are the same for all arms, and for all domains with as many.
        """
        evaluations = [self.scored[place[0], seed][1][place[1]] for seed in seeds]

        def values(weights: np.ndarray | None = None) -> list[list[float]]:
            found = [each.summary(weights) for each in evaluations]
            return [[tables.value(each, measure) for measure in tables.MEASURES] for each in found]

        key = (*place, *seeds)
        if key not in self._known:
            count, resamples = len(self.study.tests[place[1]]), self.config.bootstrap
            rng, equal = np.random.default_rng([7, count]), np.full(count, 1 / count)
            drawn = [values(rng.multinomial(count, equal).astype(float)) for _ in range(resamples)]
            self._known[key] = np.reshape(drawn, (resamples, len(seeds), len(tables.MEASURES)))
        return np.array(values()), self._known[key]

    def tables(self) -> dict[str, tables.ResultTable]:
        """The paper's table 2 (detection) and 3 (keypoints) for these arms, and the differences."""
        config, runs = self.config, self.summaries
        made = {"overview": tables.overview_table(self.means, self.differences, config.baseline)}
        if self.study.hidden:
            made["effects"] = hidden.effect_table(self)
        if self.gains and config.oracle:
            made["oracle"] = target.gain_table(self.gains, config.baseline, config.oracle)
        scores = {**self.means, **(tables.TABLES_2_3 if config.published else {})}
        made["detection"] = tables.score_table("Object detection", scores, ["box_ap", "iou"], self.spreads)
        measured = ["keypoint_ap_paper", "oks_paper", "keypoint_ap_coco", "oks_coco"]
        made["keypoints"] = tables.score_table("Keypoint regression", scores, measured, self.spreads)
        if config.published:
            made["keypoints"] = made["keypoints"].with_note(tables.WHICH_OKS)
            made["comparison"] = tables.comparison_table(self.means)
        poses = {a: {d: [runs[a, s][d] for s in self.seeds(a)] for d in self.study.tests} for a in self.means}
        made["poses"] = tables.pose_table(poses)
        made["differences"] = tables.difference_table(self.differences, config.baseline)
        if self.others:
            others = self._over_seeds(self.others)
            other = training.other_weights(config.weights)
            made["weights"] = tables.weights_table(config.weights, self.means, other, others)
        seen = target.transductive(self.study)
        return {name: tables.marked(table, seen) for name, table in made.items()}

    def to_json(self) -> dict[str, Any]:
        return {
            "schema": 1,
            "name": self.config.name,
            "runs": [
                {
                    "arm": arm,
                    "seed": seed,
                    "hash": run.folder.name.rsplit("-", 1)[-1],
                    "seconds": run.seconds,
                    "surroundings": run.surroundings,
                    "weights": self.config.weights,
                    "scores": self.summaries[arm, seed],
                    training.other_weights(self.config.weights): self.others.get((arm, seed)),
                }
                for (arm, seed), (run, _) in self.scored.items()
            ],
            "differences": [d.__dict__ for d in self.differences],
            "by_chance": tables.by_chance(self.differences),
            "mixed": self.mixed,
            "cameras_from_test_images": target.transductive(self.study),
            "intervals": self.interval_covers,
            "failures": [f.__dict__ for f in self.failures],
            "oracle": [gain.__dict__ for gain in self.gains],
            "hidden_effects": [outcome.to_json() for outcome in hidden.outcomes(self)],
        }

    def write(self, folder: str | Path) -> Path:
        """Tables as Markdown, CSV and LaTeX, everything as JSON, CSVs of images and of poses by run and domain."""
        folder = Path(folder)
        made = self.tables()
        for name, table in made.items():
            write_text(folder / f"{name}.csv", table.to_csv())
            write_text(folder / f"{name}.tex", table.to_latex())
        notes = [f"Seeds: {', '.join(map(str, self.config.seeds))}; {self.interval_covers}."]
        notes += [self.mixed] if self.mixed else []
        notes += [f"Failed: {f.arm}, seed {f.seed}: {f.error}" for f in self.failures]
        text = "\n".join([f"# {self.config.name}", "", *(t.to_markdown() for t in made.values()), *notes])
        write_text(folder / "tables.md", text + "\n")
        write_json(folder / "ablation.json", self.to_json())
        for (arm, seed), (_, each) in self.scored.items():
            for domain, evaluation in each.items():
                name = f"{arm}-seed{seed}-{domain}.csv"
                evaluation.write_csv(folder / "images" / name)
                save_poses(folder / "poses" / name, evaluation.poses, evaluation.found)
        return folder / "tables.md"


def ablate(config: Config, progress: Progress | None = None, announce: Say | None = None) -> Ablation:
    """Train the arms of a config with all else equal, score them on all test sets, and say what differs and how surely.

    Everything that is finished is kept: runs by their folders, predictions beside them. A run that fails is noted
    and the others go on; the same command tries it again. `announce` gets, before any training, what this device does
    otherwise than asked, the hours that it costs, and how strong the arms' noise is (also in noise.md).
    """
    check_arms(config, announce)
    shutil.rmtree(config.output / "failures", ignore_errors=True)  # of an earlier try
    study = prepare(config, progress, announce)
    config = study.config
    noise = strengths(study)
    write_text(config.output / "noise.md", noise.text() + "\n")
    if announce is not None:
        announce(noise.text())
    runs = [(arm, seed) for seed in config.seeds for arm in config.arms]
    try:
        start_network(study, progress)  # before the runs are spread, for all start from it
    except Exception as error:
        said = note_failure(study, "start", config.start.seed if config.start else 0, error)
        problem = f"the network that all runs start from could not be trained ({said})"
        raise InputError(problem, file=config.output / "failures") from error
    lost = spread(study, runs, training.run_and_score, config.cluster, progress) if config.cluster else {}
    scored, failures, others = {}, [], {}
    for arm, seed in runs:
        if (arm, seed) in lost:
            failures.append(Failure(arm, seed, lost[arm, seed]))
            continue
        try:
            run, scored_sets, others[arm, seed] = training.run_and_score(study, arm, seed, progress)
            scored[arm, seed] = run, scored_sets
        except Exception as error:
            failures.append(Failure(arm, seed, note_failure(study, arm, seed, error)))
    if not scored:
        first = failures[0].error if failures else "no arm"
        raise InputError(f"no run ended well ({first})", file=config.output / "failures")
    return Ablation(study, scored, tuple(failures), noise, {k: v for k, v in others.items() if v})
