//! Two runs of one plan, before a change and after: what got worse. Correctness is compared exactly, accuracy by tests.
//!
//! Possible errors, and their countermeasures:
//!
//! - *False alarms over thousands of comparisons*: their p-values are corrected by Holm (1979), Scandinavian Journal of Statistics 6(2), 65-70, for any
//!   dependence. Equally good programs fail with a probability of `alpha` at most, all comparisons together.
//! - *Heavy tails*: a method that is off by 20 samples once in 200 records may show no such error in a run. Mean square errors are compared, and not their logarithms, which
//!   would favour the lucky run. The standard error is the larger of two. Welch's is large where the new run has few and large outliers. That of a permutation of all
//!   answers is large where the old run had too few. An outlier thus adds to the difference and to its standard error alike.
//! - *Counts near 0 or all*: shares are compared by Fisher's exact test (Fisher 1922, doi:10.2307/2340521).
//! - *A real loss below the corrected threshold*: in addition to every cell, all cells of a method in a grid are compared jointly. A loss that is too small in
//!   every cell is significant there. Standard scores of mean squares are averaged. Counts keep to their cells, so that cells of different difficulty and
//!   numbers of intervals do not mix. Their sum is one of independent events of unequal probabilities, which a binomial bounds (Hoeffding 1956,
//!   doi:10.1214/aoms/1177728178). Cells of one record (several outputs) count as one.
//! - *Trivial changes in large studies*: a growth below the margins does not fail, for any significance.
//! - *Equal seeds*: the same records make both runs more alike than the tests assume. The tests then lose power, and an unchanged program never fails.
//! - *Excitations that a plan draws once*: another seed draws another one, which no interval covers; compare such plans with equal seeds.

use std::collections::BTreeMap;

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};
use statrs::function::beta::checked_beta_reg;
use statrs::function::factorial::ln_binomial;

use super::error::StudyError;
use super::keys::{Delay, Place};
use super::results::{Cell, Study};
use deadtime_signal::remedy::{Message, Remedy};
use deadtime_signal::stats::NORMAL_95_EXACT;

/// The format of a gate's result.
const FORMAT: &str = "deadtime/gate@1";
/// Errors of records without noise may grow by this share of themselves …
const ROUNDING: f64 = 1e-6;
/// … and by this many samples. Iterations of continuous models end at a tolerance. Their answers move by up to 3e-5 where noise of a millionth of a millionth is added.
const ROUNDING_SAMPLES: f64 = 1e-4;
/// The limits of a change for the worse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Chance that anything fails between programs that are equally accurate, all comparisons together.
    pub alpha: f64,
    /// A root mean square error may grow by this share of itself …
    pub margin: f64,
    /// … and by as many samples.
    pub margin_samples: f64,
    /// A share (of flagged records, of wrong answers, of intervals) may get worse by this much.
    pub margin_share: f64,
}

impl Default for Gate {
    fn default() -> Self {
        Self { alpha: 0.01, margin: 0.1, margin_samples: 0.01, margin_share: 0.02 }
    }
}

/// The compared measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Measured {
    /// Cells that the baseline has.
    Cells,
    /// Root mean square error, samples; of several cells their mean.
    RmsSamples,
    /// Share of records without an answer.
    Flagged,
    /// Share of records with an answer that is wrong without saying so.
    UnflaggedWrong,
    /// Share of answers with an interval.
    WithInterval,
    /// Share of intervals that hold the truth.
    Coverage95,
}

impl Measured {
    /// Its name in a sentence.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Cells => "cells",
            Self::RmsSamples => "RMS error (samples)",
            Self::Flagged => "records without an answer",
            Self::UnflaggedWrong => "wrong unflagged",
            Self::WithInterval => "answers with an interval",
            Self::Coverage95 => "truth in 95 % interval",
        }
    }
}

/// Something that got worse, or better.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The group it belongs to, counted in [`GateReport::groups`].
    #[serde(skip)]
    pub group: usize,
    /// The grid of the plan.
    pub grid: String,
    /// Estimated from u or r.
    pub place: Place,
    /// The method with its options.
    pub method: String,
    /// The cell's key; `None`: the group's cells together.
    pub cell: Option<String>,
    /// The changed measure.
    pub measured: Measured,
    /// In the baseline.
    pub before: Option<f64>,
    /// Now.
    pub after: Option<f64>,
    /// 95 % interval in the baseline, where the study has one.
    pub before_ci95: Option<[f64; 2]>,
    /// The same now.
    pub after_ci95: Option<[f64; 2]>,
    /// Records, answers or intervals that it was measured on, in the baseline.
    pub before_count: usize,
    /// The same now.
    pub after_count: usize,
    /// Chance of such a change anywhere in the comparison if nothing had changed (Holm); `None`: known exactly.
    pub p_value: Option<f64>,
}

/// One method of a grid and place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GateGroup {
    /// The grid of the plan.
    pub grid: String,
    /// Estimated from u or r.
    pub place: Place,
    /// The method with its options.
    pub method: String,
    /// Cells that were compared.
    pub cells: usize,
    /// Tests of chance and exact comparisons that were made.
    pub comparisons: usize,
    /// Means over the cells: root mean square error, then the shares, before and after.
    pub means: Vec<(Measured, Option<f64>, Option<f64>)>,
    /// The baseline has none of its cells.
    pub new: bool,
}

/// The result of a gate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GateReport {
    /// `deadtime/gate@1`.
    pub format: &'static str,
    /// The plan.
    pub plan: String,
    /// Seeds of the baseline and of the results.
    pub seeds: [u64; 2],
    /// The chance of a false alarm that was allowed.
    pub alpha: f64,
    /// Cells that were compared.
    pub cells: usize,
    /// Those of them without noise, compared exactly.
    pub exact_cells: usize,
    /// Tests that the correction counts.
    pub tests: usize,
    /// The changes for the worse; empty: the gate is passed.
    pub worse: Vec<Finding>,
    /// The changes for the better by the same tests.
    pub better: Vec<Finding>,
    /// Cells that the baseline does not have.
    pub new_cells: usize,
    /// Every method of every grid and place.
    pub groups: Vec<GateGroup>,
}

/// A cell in both runs.
struct Pair<'a> {
    before: &'a Cell,
    after: &'a Cell,
    exact: bool,
}

/// Bad ones of all, before and after.
#[derive(Clone, Copy)]
struct Counts {
    bad: [u64; 2],
    all: [u64; 2],
}

/// A comparison that chance has a part in: one-sided p-values of worse and better.
struct Tested {
    finding: Finding,
    p: [f64; 2],
    relevant: [bool; 2],
}

impl Gate {
    /// Compares results with their baseline.
    ///
    /// # Errors
    /// [`StudyError::Gate`] where the two are no runs of one plan, or hold numbers that no study has.
    pub fn compare(&self, results: &Study, baseline: &Study) -> Result<GateReport, StudyError> {
        self.check()?;
        let before = index(baseline, "the baseline")?;
        let after = index(results, "the results")?;
        comparable(results, baseline, &before, &after)?;
        let (mut grouped, new_cells) = grouped(results, baseline, &before, &after);
        let (mut worse, mut better, mut tested) = (Vec::new(), Vec::new(), Vec::new());
        for (at, Grouped { group, pairs, missing }) in grouped.iter_mut().enumerate() {
            let frame = Frame { at, group: &*group };
            worse.extend(frame.missing(missing, pairs.is_empty()));
            let (exact, chance): (Vec<&Pair>, Vec<&Pair>) = pairs.iter().partition(|p| p.exact);
            for pair in &exact {
                let [w, b] = frame.exact(pair);
                worse.extend(w);
                better.extend(b);
            }
            let tests = self.tests(frame, &chance);
            group.cells = pairs.len();
            group.comparisons = exact.len() * EXACT.len() + tests.len();
            group.means = means(pairs);
            tested.extend(tests);
        }
        for (side, list) in [&mut worse, &mut better].into_iter().enumerate() {
            let corrected = holm(&tested.iter().map(|t| t.p[side]).collect::<Vec<f64>>());
            let found = (tested.iter().zip(corrected))
                .filter(|(t, p)| t.relevant[side] && *p <= self.alpha)
                .map(|(t, p)| Finding { p_value: Some(p), ..t.finding.clone() });
            list.extend(found);
            list.sort_by_key(|f: &Finding| f.group);
        }
        let pairs = || grouped.iter().flat_map(|g| &g.pairs);
        Ok(GateReport {
            format: FORMAT,
            plan: results.plan.clone(),
            seeds: [baseline.seed, results.seed],
            alpha: self.alpha,
            cells: pairs().count(),
            exact_cells: pairs().filter(|p| p.exact).count(),
            tests: tested.len(),
            worse,
            better,
            new_cells,
            groups: grouped.into_iter().map(|g| g.group).collect(),
        })
    }

    fn check(&self) -> Result<(), StudyError> {
        let Self { alpha, margin, margin_samples, margin_share } = *self;
        let wrong = |detail: String| Err(StudyError::Gate { detail: detail.into() });
        if !(alpha > 0.0 && alpha < 1.0) {
            return wrong(format!("alpha is {alpha}: give a chance between 0 and 1"));
        }
        if let Some((name, value)) =
            [("margin", margin), ("margin-samples", margin_samples), ("margin-share", margin_share)]
                .iter()
                .find(|(_, v)| !(*v >= 0.0 && v.is_finite()))
        {
            return wrong(format!("{name} is {value}: give 0 or more"));
        }
        Ok(())
    }

    /// Every comparison of one group's cells that can come out worse or better at all.
    fn tests(&self, frame: Frame<'_>, pairs: &[&Pair]) -> Vec<Tested> {
        let mut tests = Vec::new();
        let clusters = clusters(pairs);
        let squares: Vec<Option<f64>> = pairs.iter().map(|p| score(p)).collect();
        for (pair, z) in pairs.iter().zip(&squares) {
            let (before, after) = (pair.before, pair.after);
            if let (Some(z), Some(b), Some(a)) = (z, before.rms_samples, after.rms_samples) {
                let finding = Finding {
                    before_ci95: before.rms_ci95_samples,
                    after_ci95: after.rms_ci95_samples,
                    ..frame.finding(
                        Some(before),
                        Measured::RmsSamples,
                        (Some(b), scored(before)),
                        (Some(a), scored(after)),
                    )
                };
                tests.push(Tested { finding, p: both_tails(*z), relevant: self.grew(b, a) });
            }
            for (measured, counts) in shares(pair) {
                if let Some(p) = fisher(counts) {
                    tests.push(self.share(frame, Some(before), measured, &[counts], p));
                }
            }
        }
        if pairs.len() < 2 {
            return tests;
        }
        // The group as a whole.
        tests.extend(self.mean_squares(frame, pairs, &clusters, &squares));
        tests.extend(SHARES.into_iter().filter_map(|m| self.shares(frame, pairs, &clusters, m)));
        tests
    }

    /// The mean squares of a group together.
    fn mean_squares(
        &self,
        frame: Frame<'_>,
        pairs: &[&Pair],
        clusters: &[usize],
        squares: &[Option<f64>],
    ) -> Option<Tested> {
        let mut sums: BTreeMap<usize, [f64; 2]> = BTreeMap::new();
        let mut known = 0;
        for (cluster, z) in clusters.iter().zip(squares) {
            let Some(z) = z else { continue };
            let [sum, count] = sums.entry(*cluster).or_default();
            *sum += z;
            *count += 1.0;
            known += 1;
        }
        if known < 2 {
            return None;
        }
        let z =
            sums.values().map(|[sum, count]| sum / count).sum::<f64>() / (sums.len() as f64).sqrt();
        let answered = || {
            pairs.iter().filter(|p| p.before.rms_samples.is_some() && p.after.rms_samples.is_some())
        };
        let side = |of: &dyn for<'p> Fn(&Pair<'p>) -> &'p Cell| {
            let mean = average(answered().filter_map(|p| of(p).rms_samples))?;
            Some((mean, answered().map(|p| scored(of(p))).sum::<usize>()))
        };
        let (before, after) = (side(&|p| p.before)?, side(&|p| p.after)?);
        let shown = |(mean, count): (f64, usize)| (Some(mean), count);
        Some(Tested {
            finding: frame.finding(None, Measured::RmsSamples, shown(before), shown(after)),
            p: both_tails(z),
            relevant: self.grew(before.0, after.0),
        })
    }

    /// One share of a group's cells together.
    fn shares(
        &self,
        frame: Frame<'_>,
        pairs: &[&Pair],
        clusters: &[usize],
        measured: Measured,
    ) -> Option<Tested> {
        let of = |p: &Pair| shares(p).into_iter().find(|(m, _)| *m == measured).map(|(_, c)| c);
        let all: Vec<(usize, Counts)> = (0..pairs.len())
            .filter_map(|i| Some((clusters[i], of(pairs[i])?)))
            .filter(|(_, c)| c.all.iter().all(|n| *n > 0))
            .collect();
        let open: Vec<&(usize, Counts)> = all.iter().filter(|(_, c)| c.can_differ()).collect();
        if open.len() < 2 {
            return None;
        }
        let mut sizes: BTreeMap<usize, u32> = BTreeMap::new();
        open.iter().for_each(|(cluster, _)| *sizes.entry(*cluster).or_default() += 1);
        let largest = sizes.values().max().copied().unwrap_or(1);
        let open: Vec<Counts> = open.iter().map(|(_, c)| *c).collect();
        let p = stratified(&open, f64::from(largest));
        let counts: Vec<Counts> = all.iter().map(|(_, c)| *c).collect();
        Some(self.share(frame, None, measured, &counts, p))
    }

    /// Worse by more than the margins; better by as much.
    fn grew(&self, before: f64, after: f64) -> [bool; 2] {
        let grew =
            |from: f64, to: f64| to - from > self.margin * from && to - from > self.margin_samples;
        [grew(before, after), grew(after, before)]
    }

    fn share(
        &self,
        frame: Frame<'_>,
        cell: Option<&Cell>,
        measured: Measured,
        counts: &[Counts],
        p: [f64; 2],
    ) -> Tested {
        let shown = |side: usize| {
            let sum = |of: &dyn Fn(&Counts) -> u64| counts.iter().map(of).sum::<u64>();
            let (bad, all) = (sum(&|c| c.bad[side]), sum(&|c| c.all[side]));
            (shown(measured, ratio(bad, all)), usize::try_from(all).unwrap_or(usize::MAX))
        };
        let relevant = [growth(counts), growth(&reversed(counts))].map(|g| g > self.margin_share);
        Tested { finding: frame.finding(cell, measured, shown(0), shown(1)), p, relevant }
    }
}

/// A group with its cells.
struct Grouped<'a> {
    group: GateGroup,
    pairs: Vec<Pair<'a>>,
    /// Cells of the baseline that the results lack.
    missing: Vec<&'a Cell>,
}

/// The cells of both runs by method, grid and place; and how many the baseline does not have.
fn grouped<'a>(
    results: &'a Study,
    baseline: &'a Study,
    before: &BTreeMap<String, &Cell>,
    after: &BTreeMap<String, &'a Cell>,
) -> (Vec<Grouped<'a>>, usize) {
    let (mut all, mut new_cells): (Vec<Grouped>, _) = (Vec::new(), 0);
    let old = baseline.cells.iter().map(|c| (c, true));
    for (cell, in_baseline) in old.chain(results.cells.iter().map(|c| (c, false))) {
        let method = cell.method_text();
        let same = |Grouped { group: g, .. }: &Grouped| {
            g.grid == cell.grid && g.place == cell.place && g.method == method
        };
        let at = all.iter().position(same).unwrap_or_else(|| {
            let group = GateGroup {
                grid: cell.grid.clone(),
                place: cell.place,
                method,
                cells: 0,
                comparisons: 0,
                means: Vec::new(),
                new: !in_baseline,
            };
            all.push(Grouped { group, pairs: Vec::new(), missing: Vec::new() });
            all.len() - 1
        });
        match (in_baseline, after.get(&cell.key()), before.contains_key(&cell.key())) {
            (true, Some(&now), _) => {
                let same_records = baseline.seed == results.seed && cell.trials == now.trials;
                let exact = is_quiet(cell) && same_records || cell.repeatable && now.repeatable;
                all[at].pairs.push(Pair { before: cell, after: now, exact });
            }
            (true, None, _) => all[at].missing.push(cell),
            (false, _, false) => new_cells += 1,
            (false, ..) => {}
        }
    }
    (all, new_cells)
}

/// A group with its number, which its findings carry.
#[derive(Clone, Copy)]
struct Frame<'a> {
    at: usize,
    group: &'a GateGroup,
}

/// Shares that are tested.
const SHARES: [Measured; 4] =
    [Measured::Flagged, Measured::UnflaggedWrong, Measured::WithInterval, Measured::Coverage95];
/// The measures that are compared exactly in cells without noise. Intervals there are of rounding's width, and whether they hold the truth is chance.
const EXACT: [Measured; 3] = [Measured::RmsSamples, Measured::Flagged, Measured::UnflaggedWrong];

impl Frame<'_> {
    fn finding(
        &self,
        cell: Option<&Cell>,
        measured: Measured,
        before: (Option<f64>, usize),
        after: (Option<f64>, usize),
    ) -> Finding {
        Finding {
            group: self.at,
            grid: self.group.grid.clone(),
            place: self.group.place,
            method: self.group.method.clone(),
            cell: cell.map(Cell::key),
            measured,
            before: before.0,
            after: after.0,
            before_ci95: None,
            after_ci95: None,
            before_count: before.1,
            after_count: after.1,
            p_value: None,
        }
    }

    /// One finding for a method that vanished, one for every cell that is missing of another.
    fn missing(&self, cells: &[&Cell], vanished: bool) -> Vec<Finding> {
        if vanished && !cells.is_empty() {
            return vec![self.finding(None, Measured::Cells, (None, cells.len()), (None, 0))];
        }
        cells.iter().map(|c| self.finding(Some(c), Measured::Cells, (None, 1), (None, 0))).collect()
    }

    /// The changes in a cell without noise: worse, better.
    fn exact(&self, pair: &Pair) -> [Vec<Finding>; 2] {
        let (before, after) = (pair.before, pair.after);
        let values = |cell: &Cell| {
            let share = |count: usize| ratio(count as u64, cell.trials as u64);
            [
                (cell.rms_samples, scored(cell)),
                (share(cell.flagged), cell.trials),
                (share(cell.unflagged_wrong), cell.trials),
            ]
        };
        let above = |from: Option<f64>, to: Option<f64>| {
            from.zip(to).is_some_and(|(from, to)| to > from * (1.0 + ROUNDING) + ROUNDING_SAMPLES)
        };
        let mut found = [Vec::new(), Vec::new()];
        for ((measured, b), a) in EXACT.into_iter().zip(values(before)).zip(values(after)) {
            for (side, differs) in [above(b.0, a.0), above(a.0, b.0)].into_iter().enumerate() {
                if differs {
                    found[side].push(self.finding(Some(before), measured, b, a));
                }
            }
        }
        found
    }
}

/// Cells by key, after a check of their content.
fn index<'a>(study: &'a Study, which: &str) -> Result<BTreeMap<String, &'a Cell>, StudyError> {
    let wrong = |detail: String| StudyError::Gate {
        detail: format!("{which}: {detail}; run the study again").into(),
    };
    let mut cells = BTreeMap::new();
    for cell in &study.cells {
        let positive = |v: Option<f64>| v.is_none_or(|v| v.is_finite() && v >= 0.0);
        let fine = cell.flagged <= cell.trials
            && cell.unflagged_wrong <= cell.trials
            && cell.scored <= cell.trials
            && cell.intervals <= cell.trials
            && positive(cell.rms_samples)
            && cell.rms_ci95_samples.is_none_or(|[lo, hi]| lo >= 0.0 && hi.is_finite() && lo <= hi)
            && cell.coverage95.is_none_or(|c| (0.0..=1.0).contains(&c));
        if !fine {
            return Err(wrong(format!(
                "the cell `{}` holds counts above its trials, or numbers out of range",
                cell.key()
            )));
        }
        if cells.insert(cell.key(), cell).is_some() {
            return Err(wrong(format!("it has two cells `{}`", cell.key())));
        }
    }
    if cells.is_empty() {
        return Err(wrong("it has no cells".to_owned()));
    }
    Ok(cells)
}

/// Whether both are runs of one plan, and scored alike.
fn comparable(
    results: &Study,
    baseline: &Study,
    before: &BTreeMap<String, &Cell>,
    after: &BTreeMap<String, &Cell>,
) -> Result<(), StudyError> {
    let wrong = |fault: String| {
        let detail = Message::from(fault)
            .and(": compare runs of one plan, or make a new baseline (")
            .and(Remedy::Update)
            .and(")");
        Err(StudyError::Gate { detail })
    };
    if results.plan != baseline.plan {
        return wrong(format!(
            "the baseline is of plan `{}`, the results are of plan `{}`",
            baseline.plan, results.plan
        ));
    }
    let mut shared =
        before.iter().filter_map(|(key, b)| Some((key, *b, *after.get(key)?))).peekable();
    if shared.peek().is_none() {
        return wrong("the results have none of the baseline's cells".to_owned());
    }
    for (key, b, a) in shared {
        if b.truth != a.truth {
            return wrong(format!(
                "`{key}` is scored against `truth = \"{}\"` in the baseline and `\"{}\"` in the results",
                b.truth.name(),
                a.truth.name()
            ));
        }
        if b.definition != a.definition && !b.definition.is_empty() && !a.definition.is_empty() {
            return wrong(format!(
                "the names in `{key}` (excitation, noise, controller, model file) or its scoring stand for something else in the baseline"
            ));
        }
    }
    Ok(())
}

/// Nothing is added to the outputs. A noise with another name than `white` may have an absolute level.
fn is_quiet(cell: &Cell) -> bool {
    cell.snr.is_none() && cell.noise == "white"
}

/// Records whose error is used; missing in a study of an older program.
fn scored(cell: &Cell) -> usize {
    if cell.scored > 0 { cell.scored } else { cell.trials - cell.flagged }
}

/// A share of bad ones for display: of intervals, the existing ones and those that hold the truth.
fn shown(measured: Measured, bad: Option<f64>) -> Option<f64> {
    bad.map(|bad| {
        if matches!(measured, Measured::WithInterval | Measured::Coverage95) {
            1.0 - bad
        } else {
            bad
        }
    })
}

fn ratio(count: u64, all: u64) -> Option<f64> {
    (all > 0).then(|| count as f64 / all as f64)
}

/// Bad ones of each share.
fn shares(pair: &Pair) -> Vec<(Measured, Counts)> {
    let of = |cell: &Cell| {
        let answers = (cell.trials - cell.flagged) as u64;
        // A study of an older program has no number of intervals.
        let intervals = if cell.intervals == 0 && cell.coverage95.is_some() {
            answers
        } else {
            cell.intervals as u64
        };
        let outside = ((1.0 - cell.coverage95.unwrap_or(1.0)) * intervals as f64).round() as u64;
        let trials = cell.trials as u64;
        [
            (cell.flagged as u64, trials),
            (cell.unflagged_wrong as u64, trials),
            (answers.saturating_sub(intervals), answers),
            (outside, intervals),
        ]
    };
    (SHARES.into_iter().zip(of(pair.before)).zip(of(pair.after)))
        .map(|((measured, (b, of_b)), (a, of_a))| {
            (measured, Counts { bad: [b, a], all: [of_b, of_a] })
        })
        .collect()
}

impl Counts {
    /// With the margins of this table there is more than one way to fill it.
    fn can_differ(&self) -> bool {
        let bad = self.bad[0] + self.bad[1];
        self.all[0] > 0 && self.all[1] > 0 && bad > 0 && bad < self.all[0] + self.all[1]
    }

    fn reversed(self) -> Self {
        let swap = |[a, b]: [u64; 2]| [b, a];
        Self { bad: swap(self.bad), all: swap(self.all) }
    }

    /// Good and bad, and before and after, swapped: the probabilities are unchanged.
    fn turned(self) -> Self {
        let good = [self.all[1] - self.bad[1], self.all[0] - self.bad[0]];
        Self { bad: good, all: [self.all[1], self.all[0]] }
    }

    /// Bad ones after beyond those that the share before would have made.
    fn surplus(&self) -> f64 {
        self.bad[1] as f64 - ratio(self.bad[0], self.all[0]).unwrap_or(0.0) * self.all[1] as f64
    }

    /// Bad ones after that were to be expected, had nothing changed.
    fn expected(&self) -> f64 {
        (self.bad[0] + self.bad[1]) as f64 * self.all[1] as f64
            / (self.all[0] + self.all[1]).max(1) as f64
    }
}

fn reversed(tables: &[Counts]) -> Vec<Counts> {
    tables.iter().map(|t| t.reversed()).collect()
}

/// The growth of the share of bad ones, cell by cell: numbers of intervals may have moved between cells of different difficulty.
fn growth(tables: &[Counts]) -> f64 {
    let of: u64 = tables.iter().map(|t| t.all[1]).sum();
    tables.iter().map(Counts::surplus).sum::<f64>() / of.max(1) as f64
}

/// Cells that share their records: the same setting seen at another output or input.
fn clusters(pairs: &[&Pair]) -> Vec<usize> {
    // With one delay per input the cells of a record differ in it.
    let one_input =
        pairs.iter().all(|p| Some(&p.before.input) == pairs.first().map(|f| &f.before.input));
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    pairs
        .iter()
        .map(|p| {
            let mut record = Cell {
                input: String::new(),
                output: String::new(),
                max_delay: 0,
                ..p.before.clone()
            };
            if !one_input {
                record.delay_s = Delay::Same(0.0);
            }
            let next = seen.len();
            *seen.entry(record.key()).or_insert(next)
        })
        .collect()
}

/// Standard score of the growth of a cell's mean square error; `None` where it cannot have grown, or nothing is known of its spread.
fn score(pair: &Pair) -> Option<f64> {
    let [b, a] = [Moments::of(pair.before)?, Moments::of(pair.after)?];
    let all = b.count + a.count;
    let grown = a.mean - b.mean;
    let variance = (b.count * b.variance + a.count * a.variance) / all
        + b.count * a.count * (grown / all).powi(2);
    let permuted = variance * all / (all - 1.0) * (1.0 / b.count + 1.0 / a.count);
    let [of_b, of_a] = [&b, &a].map(|m| m.variance / (m.count - 1.0));
    let welch = of_b + of_a;
    let error = welch.max(permuted).sqrt();
    // Welch (1947), doi:10.1093/biomet/34.1-2.28, and Satterthwaite (1946), doi:10.2307/3002019.
    let freedom = if welch > 0.0 {
        welch * welch / (of_b * of_b / (b.count - 1.0) + of_a * of_a / (a.count - 1.0))
    } else {
        b.count.min(a.count) - 1.0
    };
    let t = grown / error;
    if !(error > 0.0 && t.is_finite() && freedom.is_finite()) {
        return None;
    }
    let tail = StudentsT::new(0.0, 1.0, freedom.max(1.0)).ok()?.cdf(-t.abs());
    Some(-t.signum() * Normal::standard().inverse_cdf(tail.clamp(f64::MIN_POSITIVE, 0.5)))
}

/// Mean and variance of squared errors.
struct Moments {
    count: f64,
    mean: f64,
    variance: f64,
}

impl Moments {
    /// From the study's interval.
    fn of(cell: &Cell) -> Option<Self> {
        let (rms, [_, high]) = (cell.rms_samples?, cell.rms_ci95_samples?);
        let count = scored(cell) as f64;
        let mean = rms * rms;
        // Where no error was seen, the interval's end is what may have been missed, and the spread is 0.
        let error =
            if mean > 0.0 { ((high * high - mean) / NORMAL_95_EXACT).max(0.0) } else { 0.0 };
        (count > 1.0).then_some(Self { count, mean, variance: error * error * (count - 1.0) })
    }
}

/// Chances of a standard score as large, and as small.
fn both_tails(z: f64) -> [f64; 2] {
    let normal = Normal::standard();
    [normal.cdf(-z), normal.cdf(z)]
}

/// One-sided chances of as many bad ones after, and of as many before, with the table's margins: Fisher's exact test. `None` where the margins leave no choice.
fn fisher(counts: Counts) -> Option<[f64; 2]> {
    counts.can_differ().then(|| [counts, counts.reversed()].map(|c| hypergeometric_tail(&c)))
}

fn hypergeometric_tail(c: &Counts) -> f64 {
    let (bad, good) = (c.bad[0] + c.bad[1], c.all[0] + c.all[1] - c.bad[0] - c.bad[1]);
    let whole = ln_binomial(bad + good, c.all[1]);
    let chance = |k: u64| {
        (ln_binomial(bad, k) + ln_binomial(good, c.all[1].saturating_sub(k)) - whole).exp()
    };
    (c.bad[1]..=bad.min(c.all[1])).map(chance).sum::<f64>().min(1.0)
}

/// The same for several tables together, each keeping its margins. Their sum is one of independent events of unequal probabilities. Its tail beyond its mean
/// plus 1 is below that of the binomial of the same mean; `shared` tables of one record count as one.
fn stratified(tables: &[Counts], shared: f64) -> [f64; 2] {
    let tail = |tables: &[Counts]| {
        // Whichever are fewer, bad or good, make the sharper bound.
        let bad: u64 = tables.iter().map(|t| t.bad[0] + t.bad[1]).sum();
        let all: u64 = tables.iter().map(|t| t.all[0] + t.all[1]).sum();
        let tables: Vec<Counts> = if 2 * bad > all {
            tables.iter().map(|t| t.turned()).collect()
        } else {
            tables.to_vec()
        };
        let [events, seen] = [
            tables.iter().map(|t| t.bad[0] + t.bad[1]).sum::<u64>() as f64,
            tables.iter().map(|t| t.bad[1]).sum::<u64>() as f64,
        ];
        let mean: f64 = tables.iter().map(Counts::expected).sum();
        let [events, seen, mean] = [events / shared, seen / shared, mean / shared];
        if seen < mean + 1.0 {
            return 1.0;
        }
        checked_beta_reg(seen, events - seen + 1.0, (mean / events).clamp(0.0, 1.0)).unwrap_or(1.0)
    };
    [tail(tables), tail(&reversed(tables))]
}

/// p-values that may be compared with the chance of a single false alarm among all of them.
pub(super) fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|&i, &j| p[i].total_cmp(&p[j]));
    let mut corrected = vec![1.0; p.len()];
    let mut highest = 0.0_f64;
    for (rank, &i) in order.iter().enumerate() {
        highest = highest.max((p.len() - rank) as f64 * p[i]).min(1.0);
        corrected[i] = highest;
    }
    corrected
}

fn average(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(s, n), v| (s + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Root mean square error and shares of a group, averaged over its cells.
fn means(pairs: &[Pair]) -> Vec<(Measured, Option<f64>, Option<f64>)> {
    let rms = |of: &dyn Fn(&Pair) -> Option<f64>| average(pairs.iter().filter_map(of));
    let mut all =
        vec![(Measured::RmsSamples, rms(&|p| p.before.rms_samples), rms(&|p| p.after.rms_samples))];
    for (at, measured) in SHARES.into_iter().enumerate() {
        let share = |side: usize| {
            let each = pairs.iter().filter_map(|p| {
                shares(p).get(at).and_then(|(_, c)| ratio(c.bad[side], c.all[side]))
            });
            shown(measured, average(each))
        };
        all.push((measured, share(0), share(1)));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn counts(bad: [u64; 2], all: [u64; 2]) -> Counts {
        Counts { bad, all }
    }

    #[test]
    fn fisher_judges_the_lady_tasting_tea_as_fisher_did() {
        // Four cups of each kind: all correct by chance in 1 of 70, three or more of four in 17 of 70.
        assert_abs_diff_eq!(
            hypergeometric_tail(&counts([0, 4], [4, 4])),
            1.0 / 70.0,
            epsilon = 1e-12
        );
        assert_abs_diff_eq!(
            hypergeometric_tail(&counts([1, 3], [4, 4])),
            17.0 / 70.0,
            epsilon = 1e-12
        );
        assert!(
            fisher(counts([0, 0], [4, 4])).is_none()
                && fisher(counts([4, 4], [4, 4])).is_none()
                && fisher(counts([0, 0], [0, 4])).is_none()
        );
    }

    /// The sum of independent tables, each with its margins, by adding up all cases.
    fn enumerated(tables: &[Counts]) -> f64 {
        let mut sums = vec![1.0];
        for t in tables {
            let at_least =
                |k| hypergeometric_tail(&Counts { bad: [t.bad[0] + t.bad[1] - k, k], all: t.all });
            let bad = t.bad[0] + t.bad[1];
            let first = bad.saturating_sub(t.all[0]);
            let last = bad.min(t.all[1]);
            let mut next = vec![0.0; sums.len() + usize::try_from(last).unwrap()];
            for k in first..=last {
                let chance = at_least(k) - if k < last { at_least(k + 1) } else { 0.0 };
                for (i, p) in sums.iter().enumerate() {
                    next[i + usize::try_from(k).unwrap()] += p * chance;
                }
            }
            sums = next;
        }
        let seen: u64 = tables.iter().map(|t| t.bad[1]).sum();
        sums[usize::try_from(seen).unwrap()..].iter().sum()
    }

    #[test]
    fn the_bound_on_several_tables_lies_above_their_exact_chance_and_near_it() {
        let cases = [
            vec![counts([1, 5], [20, 20]), counts([0, 4], [20, 20]), counts([2, 7], [30, 25])],
            vec![counts([0, 3], [1000, 50]), counts([1, 2], [1000, 50]), counts([0, 2], [400, 40])],
            vec![counts([17, 20], [20, 20]), counts([25, 30], [30, 30])],
            vec![counts([5, 5], [20, 20]), counts([1, 0], [20, 20])],
        ];
        for tables in cases {
            let (exact, [bound, _]) = (enumerated(&tables), stratified(&tables, 1.0));
            assert!(bound >= exact - 1e-12, "{exact} {bound}");
            // Its square root is within the exact probability: at most twice the evidence is needed.
            assert!(exact > 0.3 || bound <= exact.sqrt(), "{exact} {bound}");
            assert!(stratified(&tables, 2.0)[0] >= bound);
        }
    }

    #[test]
    fn holm_corrects_as_in_a_worked_example() {
        // Of 0.01, 0.04, 0.03, 0.005: sorted times 4, 3, 2, 1, never falling.
        let corrected = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (got, wanted) in corrected.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((got - wanted).abs() < 1e-12, "{corrected:?}");
        }
    }
}
