"""One blind case: draw a truth, tune its size, make the logs, check that they are adequate, work out the label. What a draw may retry is the size alone.

Adequate, decided before any diagnosis: the gap of the nominal model (starts fitted) is at least 10 dB above the noise over the training logs
(5 dB with --weak), at least 4 dB in each of them and 5 dB in the held-out log; commands have at least five distinct levels and no combination of eight
successive commands vanishes (smallest eigenvalue of their covariance above 1e-6 of the largest). Alone among these, `none` needs no gap.
A fault outside the catalogue must also leave more than 1.5 of the noise under the best single effect and under the best second one beside it.

In predictor mode gap and noise are those of the one-step predictions: the gap is the prediction error on noise-free outputs, the noise what the
measured outputs add to it.
"""

from dataclasses import dataclass

import numpy as np

from .aliases import EFFECTS, alias_classes, alias_classes_of_many, explanations, parameter_scales
from .catalogue import nominal_value, of_size, real_channels
from .experiment import Experiment, Inadequate
from .fit import Problem, Record, fit
from .outside import Outside
from .plants import PLANTS
from .signals import is_rich
from .structure import same_by_construction

STRONG, WEAK = (12.0, 30.0), (5.5, 10.0)  # strengths drawn, dB
MOST_SNR = 46.0  # dB, of the best sensors
ABSENT_DB = 8.0  # so much is missing that better sensors are no help: the effect does not act in some log
EXPLAINED = 1.5  # what known effects must leave of an unknown one, rms in units of the noise
SHORT = 700  # samples of the first log on which rivals are screened
MIXED, MIXED_PARAMETERS = (6.0, 28.0), (8.0, 20.0)  # strengths of a mixture's parts, dB
MIXED_OUTSIDE = ("hysteresis", "slosh", "gusts")
ALONE = ("dropped_commands", "sensor_quantisation")  # what chance decides sample by sample is no part of a sum
SEARCHED = 0.05  # of the gap: what takes less of a mixture is not worth a search for what could stand in for it
OFF = 0.01  # standard deviation of the relative errors of all parameters, where nothing else differs
OFF_DB = (-3.0, 15.0)  # how far above the noise they are to be, as far as sensors can be that good
GUSTS = (3.0, 15.0)  # strengths of gusts that act on a machine without any other difference, dB
HIDDEN_DB = 6.0  # wrong nominal parameters stay at least this far below the noise


@dataclass
class Wanted:
    group: str  # single, none, unknown, pair, mixture
    effect: str | None  # a single's effect, an unknown's kind
    weak: bool
    beside: str | None = None  # of a mixture "nothing", "parameters" or "outside" (None: drawn), of none "parameters" or "gusts"


def _decibel(gaps: list[tuple[float, int]]) -> float:
    energy, count = (sum(part) for part in zip(*gaps))
    return 20 * np.log10(max(np.sqrt(energy / count), 1e-9))


class Case:
    def __init__(self, rng, wanted: Wanted):
        self.rng, self.wanted = rng, wanted
        self.experiment = ex = Experiment(rng, self._plant(), wanted.effect if wanted.group == "single" else None)
        self.effects: list[dict] = []
        self.hidden: list[dict] = []  # the model file's own parameter errors, below the noise
        self.outside: Outside | None = None
        self.shares: list[float] | None = None  # of a mixture's effects
        self.logs = [ex.log(ex.model, [], i) for i in range(3)]
        self._noise_level()
        if rng.random() < 1 / 3:
            self._disturb_parameters()
        getattr(self, f"_draw_{wanted.group}")()

    def _plant(self) -> str:
        names = list(PLANTS)
        if self.wanted.effect and self.wanted.group == "single":
            names = [n for n in names if real_channels(PLANTS[n].model, self.wanted.effect, PLANTS[n])]
        return str(self.rng.choice(names))

    # --- residuals -------------------------------------------------------------------------------------------------

    def records(self, indices, measured: bool, effects=()) -> list[Record]:
        ex, found = self.experiment, []
        for i in indices:
            u, y, clean = self.logs[i]
            values = np.where(ex.runs[i].missing, np.nan, y if measured else clean)
            found.append(Record(ex.runs[i].time, u, values, ex.gain(ex.runs[i]), ex.drops(i, list(effects))))
        return found

    def problem(self, indices, measured: bool, samples: int | None = None) -> Problem:
        """Residuals in units of the noise, under the prior that the model file states (the states' own motion if it states none)."""
        ex = self.experiment
        prior = ex.start_std if ex.gives_std else ex.scales.x
        records = self.records(indices, measured, self.effects)
        for record in records if samples else []:
            record.time, record.u, record.y = record.time[:samples], record.u[:samples], record.y[:samples]
            record.drops = None if record.drops is None else record.drops[:samples]
        return Problem(ex.nominal, records, ex.sigma * self.noise_size, prior, ex.names.initial)

    def _noise_level(self) -> None:
        """The noise per output in the prediction mode of this case, in units of the sensors' noise."""
        self.known_gaps: dict[int, tuple[float, int]] = {}
        self.noise_size = np.ones(len(self.experiment.names.outputs))
        if self.experiment.predictor:
            clean, measured = self.problem((0, 1), False), self.problem((0, 1), True)
            parts = [
                m_run - c_run for m_run, c_run in (
                    (measured.raw(m, [], measured.initial), clean.raw(c, [], clean.initial)) for m, c in zip(measured.records, clean.records))
            ]
            self.noise_size = np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))

    def gaps(self, indices=(0, 1, 2)) -> list[tuple[float, int]]:
        """Per log the energy of the gap in units of the noise, and its number of samples."""
        for i in indices:
            if i not in self.known_gaps:
                problem = self.problem((i,), False)
                problem.linearise([])
                gap = problem.reduced([])
                self.known_gaps[i] = float(gap @ gap), problem.count
        return [self.known_gaps[i] for i in indices]

    def gap_db(self, indices=(0, 1)) -> float:
        return _decibel(self.gaps(indices))

    def shortfall(self) -> tuple[float, str]:
        """By how many dB the gap misses what a case needs (negative: by how many it has more), and what to call that."""
        gaps = self.gaps()
        overall = (5.0 if self.wanted.weak else 10.0) - _decibel(gaps[:2])
        single = max(4.0 - _decibel(gaps[:1]), 4.0 - _decibel(gaps[1:2]), 5.0 - _decibel(gaps[2:]))
        return max((overall, "the effect hardly shows"), (single, "the effect is missing from a log"))

    def mean_outputs(self) -> list[bool]:
        """Which outputs' operating points the model file may call "mean": those that the measured mean of the training logs meets to a tenth of the noise."""
        ex = self.experiment
        values = np.concatenate([np.where(ex.runs[i].missing, np.nan, self.logs[i][1]) for i in (0, 1)])
        points = [c.get("operating") for c in ex.nominal["outputs"]]
        close = np.abs(np.nanmean(values, axis=0) - [p or 0.0 for p in points]) <= 0.1 * ex.sigma
        return [bool(ex.mean_outputs and p is not None and c) for p, c in zip(points, close)]

    # --- truths ----------------------------------------------------------------------------------------------------

    def remake(self, indices=(0, 1, 2)) -> None:
        truth = self.outside.model() if self.outside else self.experiment.model
        for i in indices:
            self.known_gaps.pop(i, None)
            self.logs[i] = self.experiment.log(truth, self.effects, i, self.outside)

    def _disturb_parameters(self) -> None:
        """The machine differs from the model file by a few per cent, less where the noise would not hide it."""
        ex, rng = self.experiment, self.rng
        channels = [c for c in real_channels(ex.model, "parameter_error", ex.plant)]
        share = {c: rng.uniform(0.01, 0.05) * rng.choice([-1, 1]) for c in channels}
        for _ in range(6):
            self.effects = [
                {"effect": "parameter_error", "channel": c, "parameters": {"value": float(nominal_value(ex.model, c) * (1 + d))}} for c, d in share.items()
            ]
            self.remake()
            excess = self.gap_db((0, 1, 2)) + HIDDEN_DB + 0.7
            if excess <= 0:
                self.hidden = self.effects
                return
            share = {c: d * 10 ** (-(excess + 0.3) / 20) for c, d in share.items()}
        raise Inadequate("wrong parameters show")

    def _with_hidden(self, effects: list[dict]) -> list[dict]:
        named = {(e["effect"], e["channel"]) for e in effects}
        return effects + [e for e in self.hidden if (e["effect"], e["channel"]) not in named]

    def _tuned(self, make) -> float:
        """Sizes the truth for a drawn strength, smaller where a loop is lost, larger or with better sensors where it hardly shows: `make(size)` sets it."""
        low, high = WEAK if self.wanted.weak else STRONG
        target, size, largest = self.rng.uniform(low, high), 0.15, 4.0
        tried: list[tuple[float, float, float]] = []
        for _ in range(8):
            make(size)
            try:
                self.remake((0,))
                got = self.gap_db((0,))
            except (Inadequate, ArithmeticError, ValueError):
                largest, size = 0.8 * size, 0.4 * size
                continue
            tried.append((abs(got - target), got, size))
            new = float(np.clip(size * 10 ** (np.clip(target - got, -25, 25) / 20), 1e-3, largest))
            if abs(got - target) < 1.5 or abs(new - size) < 0.02 * size:
                break
            size = new
        if not tried:
            raise Inadequate("the loop is lost")
        _, got, size = min(tried)
        lacking = target - got if got < target - 1.5 else 0.0
        for _ in range(8):
            if lacking > ABSENT_DB and size < largest:
                size, lacking = min(1.7 * size, largest), 0.0
            if lacking > 0:
                self.hidden = []  # less noise would not hide it
                self._quieten(lacking)
            make(size)
            try:
                self.remake()
                if lacking > 0:
                    self._noise_level()
                if not self.outside:
                    self.problem((0,), False).linearise(self.effects[:1])  # from other starts too it must not run away
            except (Inadequate, ArithmeticError, ValueError):
                largest, size, lacking = 0.8 * size, 0.6 * size, 0.0
                continue
            lacking = self.shortfall()[0] + 0.3
            if lacking <= 0.3 or self.snr() >= MOST_SNR - 0.01:
                return size
        raise Inadequate("the loop is lost")

    def snr(self) -> float:
        """Of the output where it is least, dB."""
        return float(20 * np.log10(np.min(self.experiment.scales.y / self.experiment.sigma)))

    def _quieten(self, decibel: float) -> None:
        """Where even a large effect hardly shows the sensors are better, up to `MOST_SNR`."""
        ex = self.experiment
        ex.sigma = ex.sigma * 10 ** (-np.clip(decibel, 0.0, max(MOST_SNR - self.snr(), 0.0)) / 20)

    def _shape(self) -> tuple:
        return tuple(self.rng.random(3))

    def _sign(self, effect: str) -> float:
        """Sensors that look ahead cannot be in a loop, so a loop's clock errors are positive."""
        return 1.0 if self.experiment.closed and effect.startswith("clock") else float(self.rng.choice([-1.0, 1.0]))

    def _draw_one(self, effect: str):
        ex = self.experiment
        choices = real_channels(ex.nominal, effect, ex.plant)
        if not choices:
            raise Inadequate(f"{effect} has no place")
        channel, sign, shape = str(self.rng.choice(choices)), self._sign(effect), self._shape()
        return lambda size: of_size(ex.scales, effect, channel, size, sign, shape)

    def _draw_single(self) -> None:
        one = self._draw_one(self.wanted.effect)

        def make(size):
            self.effects = self._with_hidden([one(size)])

        self._tuned(make)
        self.effects = self.effects[:1]

    _draw_moving = _draw_stepping = _draw_single

    def _draw_pair(self) -> None:
        ex = self.experiment
        possible = [e for e in EFFECTS if real_channels(ex.nominal, e, ex.plant)]
        both = []
        for effect in self.rng.choice(possible, 2, replace=False):
            one = self._draw_one(str(effect))

            def make(size, one=one):
                self.effects = self._with_hidden([one(size)])

            both.append((one, self._tuned(make)))
        for share in (1.0, 0.7, 0.5):  # each alone was bearable; together they may lose the loop
            sized = []
            for one, size in both:
                self.effects = self._with_hidden([one(share * size)])
                self.remake((0,))
                sized.append((self.gap_db((0,)), self.effects[0]))
            weaker, stronger = sorted(sized, key=lambda pair: pair[0])
            if weaker[0] < 8.0:
                raise Inadequate("one of the pair does not show")
            self.effects = self._with_hidden([stronger[1], weaker[1]])
            try:
                self.remake()
            except (Inadequate, ArithmeticError, ValueError):
                continue
            self.effects = self.effects[:2]
            return
        raise Inadequate("the loop is lost")

    def _draw_mixture(self) -> None:
        """Two to five effects of drawn strengths, some of them weak; in a third of the cases the nominal parameters are visibly off as well, or a fault from
        outside the catalogue acts beside them."""
        ex, rng = self.experiment, self.rng
        possible = [e for e in EFFECTS if e not in ALONE and real_channels(ex.nominal, e, ex.plant)]
        count = int(rng.integers(2, 6))
        beside = str(rng.choice(["nothing", "parameters", "outside"]))
        beside = self.wanted.beside or beside
        parts: list[list[dict]] = []
        for effect in rng.choice(possible, min(count, len(possible)), replace=False):
            one = self._draw_one(str(effect))
            parts.append([self._sized(lambda size, one=one: [one(size)], rng.uniform(*MIXED))])
        if beside == "parameters":
            parts.append(self._sized(self._parameters(), rng.uniform(*MIXED_PARAMETERS)))
        named = [e for part in parts for e in (part if isinstance(part[0], dict) else part[0])]
        if len({(e["effect"], e["channel"]) for e in named}) < len(named):
            raise Inadequate("an effect twice")
        if beside == "outside":
            self.effects = []
            self.outside = Outside(rng, str(rng.choice(MIXED_OUTSIDE)), ex.model, ex.scales, ex.plant)
            self._sized(self._outside_of, rng.uniform(*MIXED))
        self.effects, self.hidden = named, []
        self.remake()
        self._order_by_share()

    def _parameters(self):
        """All nominal parameters off by drawn parts of one size."""
        ex, rng = self.experiment, self.rng
        parts = {c: rng.normal() for c in real_channels(ex.model, "parameter_error", ex.plant)}

        def made(size):
            return [
                {"effect": "parameter_error", "channel": c, "parameters": {"value": float(nominal_value(ex.model, c) * (1 + np.clip(0.3 * size * p, -0.6, 0.6)))}}
                for c, p in parts.items()
            ]

        return made

    def _outside_of(self, size: float) -> list[dict]:
        self.outside.size = size
        return []

    def _sized(self, make, target: float):
        """Effects of such a size that the gap of the first log alone is about so many dB above the noise."""
        size, best = 0.15, None
        for _ in range(8):
            self.effects = make(size)
            try:
                self.remake((0,))
                got = self.gap_db((0,))
            except (Inadequate, ArithmeticError, ValueError):
                size *= 0.4
                continue
            if best is None or abs(got - target) < best[0]:
                best = abs(got - target), size
            if abs(got - target) < 1.5:
                break
            size = float(np.clip(size * 10 ** (np.clip(target - got, -25, 25) / 20), 1e-3, 4.0))
        if best is None or best[0] > 6.0:
            raise Inadequate("an effect of the mixture does not show")
        found = make(best[1])
        self.effects = []
        return found if len(found) != 1 else found[0]

    def _order_by_share(self) -> None:
        """Shares: what the squared error, relative to each output's spread within logs, rises by without an effect, all else true; normalised.

        Errors of all nominal parameters count as one.
        """
        truth, problem = self.effects, self.problem((0, 1), False)
        left = self._energy(problem, truth)
        whole = self._energy(problem, [])
        rises = [max(self._energy(problem, [o for o in truth if o is not e]) - left, 0.0) for e in truth]
        total = sum(rises)
        if not np.isfinite(total + whole):
            raise Inadequate("without one of the effects the machine runs away")
        if total <= 0 or whole <= left:
            raise Inadequate("nothing of the mixture shows")
        order = sorted(range(len(truth)), key=lambda i: -rises[i])
        self.effects = [truth[i] for i in order]
        self.shares = [float((1 - left / whole) * rises[i] / total) for i in order]

    @staticmethod
    def _energy(problem: Problem, effects: list[dict]) -> float:
        left = [problem.raw(r, effects, problem.best_start(r, effects)) * problem.sigma for r in problem.records]
        moves = np.mean([np.nanvar(r.y, axis=0) for r in problem.records], axis=0, keepdims=True)
        if np.any(moves == 0.0):
            raise Inadequate("an output stands still throughout the logs")
        return sum(float(np.sum(residual**2 / moves)) for residual in left)

    def _draw_none(self) -> None:
        ex, rng = self.experiment, self.rng
        if self.wanted.beside == "parameters":
            errors = {c: np.clip(OFF * rng.normal(), -3 * OFF, 3 * OFF) for c in real_channels(ex.model, "parameter_error", ex.plant)}
            self.hidden = [
                {"effect": "parameter_error", "channel": c, "parameters": {"value": float(nominal_value(ex.model, c) * (1 + e))}} for c, e in errors.items()
            ]
        elif self.wanted.beside == "gusts":
            self.hidden, self.effects = [], []
            self.outside = Outside(rng, "gusts", ex.model, ex.scales, ex.plant)
            self._sized(self._outside_of, rng.uniform(*GUSTS))
        self.effects = self.hidden
        self.remake()
        lacking = rng.uniform(*OFF_DB) - self.gap_db() if self.wanted.beside == "parameters" else 0.0
        if lacking > 0:
            self._quieten(lacking)
            self._noise_level()
            self.remake()
        self.effects = []

    def _draw_unknown(self) -> None:
        ex = self.experiment
        self.effects = []
        self.outside = Outside(self.rng, self.wanted.effect, ex.model, ex.scales, ex.plant)

        def make(size):
            self.outside.size = size

        self._tuned(make)

    # --- checks and label --------------------------------------------------------------------------------------------

    def check(self) -> None:
        if not all(is_rich(u) for u, _, _ in self.logs):
            raise Inadequate("poor excitation")
        missing, reason = (0.0, "") if self.wanted.group == "none" else self.shortfall()
        if missing > 0:
            raise Inadequate(reason)

    def _aliases(self) -> list:
        """One class, of a pair one for each effect."""
        if self.wanted.group == "none":
            return []
        if self.wanted.group == "unknown":
            self._needs_unknown()
            return []
        if self.wanted.group == "mixture":
            full, short = self.problem((0, 1), False), self.problem((0,), False, SHORT)
            searched = [s >= SEARCHED and e["effect"] != "parameter_error" for e, s in zip(self.effects, self.shares)]
            return alias_classes_of_many(short, full, self.experiment.scales, self.effects, searched)
        if self.wanted.group == "moving" and self.wanted.effect != "delay_drift":
            # What stands still does not do what a jump, a slower loop or chance does; a drift may be a clock's.
            return [f"{self.effects[0]['effect']}:{self.effects[0]['channel']}"]
        full, short = self.problem((0, 1), False), self.problem((0,), False, SHORT)
        classes = alias_classes(short, full, self.experiment.scales, self.effects)
        return classes if len(classes) > 1 else classes[0]

    def _with_same(self, classes: list) -> list:
        """The classes with what does the same by construction as one of their members."""
        same = same_by_construction(self.experiment.nominal)
        if any(isinstance(c, list) for c in classes):
            return [self._with_same(c) for c in classes]
        return sorted(set(classes).union(*(same.get(name, ()) for name in classes)))

    def _needs_unknown(self) -> None:
        """No effect of the catalogue explains the fault, nor two; a larger fault is tried where they do."""
        if not self._is_explained():
            return
        self.outside.size *= 2
        self.remake()
        if self._is_explained():
            raise Inadequate("a known effect explains the unknown one")

    def _is_explained(self) -> bool:
        full, short = self.problem((0, 1), False), self.problem((0,), False, SHORT)
        best: list[dict] = []
        for _ in range(2):
            found = explanations(short, full, self.experiment.scales, best[-1:], {f"{b['effect']}:{b['channel']}" for b in best}, worth=EXPLAINED)
            if found.least < EXPLAINED:
                return True
            best = found.best
        return False

    def nrmse(self, index: int, effects: list[dict], start_prior: Problem) -> float:
        """Of one measured log, the start fitted under its prior."""
        record = start_prior.records[index]
        residual = start_prior.raw(record, effects, start_prior.best_start(record, effects)) * start_prior.sigma
        present = np.isfinite(record.y)
        if any(np.ptp(record.y[p, j]) == 0.0 for j, p in enumerate(present.T)):
            raise Inadequate("an output stands still throughout a log")
        shares = [np.mean(residual[p, j] ** 2) / np.var(record.y[p, j]) for j, p in enumerate(present.T)]
        return float(np.sqrt(np.mean(shares)))

    def label(self) -> dict:
        self.check()
        aliases = self._with_same(self._aliases())
        holdout, training = self.problem((2,), True), self.problem((0, 1), True)
        before = after = self.nrmse(0, [], holdout)
        acting = self.hidden if self.wanted.group == "none" and self.wanted.beside == "parameters" else self.effects
        if acting:
            training.linearise(acting)
            fitted, _ = fit(training, acting, parameter_scales(self.experiment.scales, acting))
            after = self.nrmse(0, fitted, holdout)
        elif self.wanted.group == "unknown":
            clean = self.problem((2,), False)
            floor = (holdout.raw(holdout.records[0], [], holdout.initial) - clean.raw(clean.records[0], [], clean.initial)) * clean.sigma
            after = float(np.sqrt(np.mean(np.mean(floor**2, axis=0) / np.nanvar(holdout.records[0].y, axis=0))))
        verdict = self.effects[0]["effect"] if self.effects else self.wanted.group
        mixed = {} if self.shares is None else {"shares": self.shares, "outside": self.outside.kind if self.outside else None}
        if self.wanted.group == "none" and self.wanted.beside:
            mixed = {"parameter_errors": self.hidden, "outside": self.outside.kind if self.outside else None}
        return {
            "group": "single" if self.wanted.group == "stepping" else self.wanted.group, "verdict": verdict, "effects": self.effects, "alias_class": aliases, **self._where(),
            "before": before, "oracle_after": after, **mixed,
        }

    def _where(self) -> dict:
        """Outputs, span (of train_1, s) and band (10 % to 90 % of the energy, Hz) of the noise-free gap, and its strength."""
        nothing = {"outputs": [], "from_s": None, "to_s": None, "from_hz": None, "to_hz": None, "strength_db": None}
        if self.wanted.group == "none" and not self.wanted.beside:
            return nothing
        ex, problem = self.experiment, self.problem((0, 1), False)
        record = problem.records[0]
        gap = problem.raw(record, [], problem.best_start(record, []))
        sizes = np.sqrt(np.mean(gap**2, axis=0))
        shown = [name for name, size in zip(ex.names.outputs, sizes) if size > 1.0] or [ex.names.outputs[int(np.argmax(sizes))]]
        energy = np.cumsum(np.sum(gap**2, axis=1))
        ends = record.time[np.searchsorted(energy, np.array([0.01, 0.99]) * energy[-1])]
        if self.outside is not None and self.outside.span is not None:
            self.outside.start(record.time, ex.runs[0].seed)
            ends = np.array(self.outside.span)
        elif ends[1] - ends[0] > 0.85 * record.time[-1]:
            ends = record.time[[0, -1]]
        step = ex.runs[0].step
        even = np.arange(int(record.time[-1] / step) + 1) * step
        gap = np.stack([np.interp(even, record.time, column) for column in gap.T], axis=1)
        power = np.cumsum(np.sum(np.abs(np.fft.rfft(gap, axis=0)) ** 2, axis=1))
        frequencies = np.fft.rfftfreq(len(gap), step)
        band = frequencies[np.searchsorted(power, np.array([0.1, 0.9]) * power[-1])]
        return {"outputs": shown, "from_s": float(ends[0]), "to_s": float(ends[1]), "from_hz": float(band[0]), "to_hz": float(band[1]), "strength_db": float(self.gap_db())}
