//! Sensors against each other, without dynamics. The pairs are velocity and slope of a position, rate and derivative of an attitude, acceleration and slope of
//! a velocity. The result is the factor, the lag and the offset between the two, each with an interval. Rotated axes are no factor.
//!
//! Pairs are the model's own: outputs of which one is the derivative of another in its equations at any parameters. Four outputs that the rates of three others
//! rotate as a quaternion are pairs too. For a model without equations the outputs' names and units are compared instead.

use deadtime_signal::decompositions::svd;
use nalgebra::{DMatrix, DVector, Quaternion};

use super::alike;
use super::alike::{Alike, Known, Part};
use super::clipped;
use super::evidence::{ALL, Evidence, result, short, uneven};
use super::kinematics;
use super::kinematics::{Relation, TOGETHER};
use super::unit;
use super::view::View;
use crate::format::diagnosis::{Check, CheckKind};
use crate::input::record::LogRecord;
use deadtime_model::simulate::Dynamics;

/// A factor that differs from 1 by less is ignored.
const FACTOR: f64 = 0.03;
/// A lag below this, samples, is none: half a sample lies between an integrator's old speed and its new one.
const LATE: f64 = 0.6;
/// An offset below this part of the rate's standard deviation is none.
const OFFSET: f64 = 0.05;
/// Wider intervals than this would not have shown a fault: of the factor, upper over lower end; of the lag, samples.
const WIDE: f64 = 1.25;
const VAGUE: f64 = 2.0;
/// A blamed sensor lies this many times half its 95 % interval away. With sixteen stretches (Student's t with 15 degrees of freedom) one in 1 400 intervals
/// does by chance, where one in 20 lies outside.
const SURE: f64 = 2.0;
/// Another axis counts from this part of the own one, and so many standard deviations.
const ACROSS: f64 = 0.1;
const CERTAIN: f64 = 5.0;
/// Half the width of the moving means of the comparison of axes, samples, and the number of stretches for their intervals.
const AXES: usize = 8;
const STRETCHES: usize = 16;
/// The part of the disagreement that must vanish after the rotation by the attitude.
const GAINED: f64 = 0.75;
/// Less than this does not go together as logged: nothing to turn.
const APART: f64 = 0.01;
/// A quaternion's length is 1 within this.
const LENGTH: f64 = 0.02;
/// Disagreement of the model's own rates that is rounding.
const ROUNDING: f64 = 1e-6;

/// Where a slope comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    /// One output, over this factor.
    Output(usize, f64),
    /// The turning of a quaternion, scalar last, about one of its body's axes.
    Turning([usize; 4], usize),
}

/// An output that is the derivative of others.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pair {
    source: Source,
    rate: usize,
    /// The source is the model's equations, not names.
    stated: bool,
}

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let turning = turning(&e.view);
    let mut pairs: Vec<Pair> = e
        .relations
        .iter()
        .map(|r| Pair { source: Source::Output(r.of, r.factor), rate: r.rate, stated: true })
        .collect();
    if !kinematics::shows_equations(&e.view) {
        pairs.extend(named(&e.view));
    }
    pairs.extend(turning.iter().flatten());
    if pairs.is_empty() {
        return Vec::new();
    }
    if !e.view.is_even() {
        let finding = uneven(" whether sensors go with each other");
        return vec![result(CheckKind::Unit, ALL, None, finding)];
    }
    let mut said = Said::default();
    let mut rest = pairs.as_slice();
    while let Some(first) = rest.first() {
        let (group, others) =
            rest.split_at(rest.iter().take_while(|p| same_kind(&e.view, first, p)).count().max(1));
        axes(e, group, &turning, &mut said);
        rest = others;
    }
    said.all()
}

/// The findings.
#[derive(Default)]
struct Said {
    found: Vec<Check>,
    agree: Vec<String>,
    untold: Vec<String>,
}

impl Said {
    fn all(mut self) -> Vec<Check> {
        if !self.agree.is_empty() {
            let finding = format!("sensors go with each other: {}", self.agree.join("; "));
            self.found.push(result(CheckKind::Unit, ALL, Some(true), finding));
        }
        if !self.untold.is_empty() {
            let finding =
                format!("undecided whether sensors go with each other: {}", self.untold.join("; "));
            self.found.push(result(CheckKind::Unit, ALL, None, finding));
        }
        self.found
    }
}

/// Pairs that may be axes of one vector.
fn same_kind(view: &View<'_>, a: &Pair, b: &Pair) -> bool {
    let unit = |i: usize| view.system.outputs[i].unit.as_deref();
    unit(a.rate) == unit(b.rate)
        && match (a.source, b.source) {
            (Source::Output(one, f), Source::Output(other, g)) => {
                unit(one) == unit(other) && (f - g).abs() <= ROUNDING * f.abs()
            }
            (Source::Turning(one, _), Source::Turning(other, _)) => one == other,
            _ => false,
        }
}

/// Names of rates: the parts before and after the name of the changing quantity.
const NAMES: [(&str, &str); 8] = [
    ("v", ""),
    ("v_", ""),
    ("d", ""),
    ("", "_dot"),
    ("", "dot"),
    ("", "_rate"),
    ("", "_velocity"),
    ("", "_speed"),
];
/// Parts of names, and what replaces each in the name of the rate.
const EXCHANGED: [(&str, &str); 6] = [
    ("position", "velocity"),
    ("pos", "vel"),
    ("angle", "rate"),
    ("velocity", "acceleration"),
    ("vel", "acc"),
    ("vel", "accel"),
];
/// Units of which the second is that of a rate of the first.
const UNITS: [[&str; 2]; 5] =
    [["m", "m/s"], ["rad", "rad/s"], ["m/s", "m/s^2"], ["deg", "deg/s"], ["rad/s", "rad/s^2"]];

/// Pairs by name, except where the units contradict the pair.
fn named(view: &View<'_>) -> Vec<Pair> {
    let outputs = &view.system.outputs;
    let goes = |of: usize, rate: usize| {
        let [a, b] = [of, rate].map(|i| outputs[i].name.to_lowercase());
        let built = NAMES.iter().any(|(before, after)| b == format!("{before}{a}{after}"));
        let exchanged =
            EXCHANGED.iter().any(|(from, to)| a.contains(from) && b == a.replacen(from, to, 1));
        // vx and ax, v_x and a_x.
        let axis =
            a.strip_prefix('v').is_some_and(|rest| !rest.is_empty() && b == format!("a{rest}"));
        let units = match (outputs[of].unit.as_deref(), outputs[rate].unit.as_deref()) {
            (Some(u), Some(v)) => UNITS.contains(&[u, &v.replace('²', "^2")]),
            _ => true,
        };
        units && (built || exchanged || axis)
    };
    let all = (0..outputs.len()).flat_map(|of| (0..outputs.len()).map(move |rate| (of, rate)));
    all.filter(|(of, rate)| of != rate && goes(*of, *rate))
        .map(|(of, rate)| Pair { source: Source::Output(of, 1.0), rate, stated: false })
        .collect()
}

fn quaternion(q: [f64; 4]) -> Quaternion<f64> {
    Quaternion::new(q[3], q[0], q[1], q[2])
}

/// Four consecutive outputs that are a quaternion, scalar last, and the three outputs that are its body's rates. The test is the model's own equations at
/// points of all kinds.
fn turning(view: &View<'_>) -> Option<[Pair; 3]> {
    let points = kinematics::points(view)?;
    let outputs = view.outputs();
    (0..outputs.saturating_sub(3)).find_map(|first| {
        let at = [first, first + 1, first + 2, first + 3];
        // Rates and outputs at every point.
        let rates = points.iter().map(|(dy, y)| {
            let q = quaternion(at.map(|i| y[i]));
            let [a, b, c, d] = at.map(|i| dy[i]);
            let change = quaternion([a?, b?, c?, d?]);
            let turn = (q.conjugate() * change).vector() * (2.0 / q.norm_squared());
            Some(([turn[0], turn[1], turn[2]], y))
        });
        let rates: Vec<_> = rates.collect::<Option<_>>()?;
        let axis = |axis: usize| {
            let same = |i: &usize| {
                rates.iter().all(|(w, y)| {
                    (w[axis] - y[*i]).abs() <= ROUNDING * (w[axis].abs() + y[*i].abs())
                })
            };
            (0..outputs).filter(|i| !at.contains(i)).find(same).map(|rate| Pair {
                source: Source::Turning(at, axis),
                rate,
                stated: true,
            })
        };
        Some([axis(0)?, axis(1)?, axis(2)?])
    })
}

/// Samples of an output; NaN where several consecutive samples are missing, or one is at a limit. A single missing sample is that of the cubic through its four
/// neighbours, which favours no side. Without this value a filter loses all samples around it, and regular gaps would leave samples of one phase alone.
fn samples(e: &Evidence<'_>, at: usize, output: usize) -> Vec<f64> {
    let record: &LogRecord = e.view.records[at];
    let limits = clipped::limits(e, at, output);
    let logged = |k: usize| {
        (k < record.time_s.len()).then(|| record.measured_in(record.train, output, k)).flatten()
    };
    let limited = |k: usize| logged(k).is_some_and(|v| limits.contains(&Some(v)));
    let between = |k: usize| {
        let [a, b, c, d] =
            [k.checked_sub(2)?, k - 1, k + 1, k + 2].map(|n| logged(n).filter(|_| !limited(n)));
        Some((4.0 * (b? + c?) - a? - d?) / 6.0)
    };
    let value = |k: usize| if limited(k) { None } else { logged(k).or_else(|| between(k)) };
    (0..record.time_s.len()).map(|k| value(k).unwrap_or(f64::NAN)).collect()
}

/// A quaternion at a sample.
fn attitude(columns: &[Vec<f64>; 4], k: usize) -> Option<Quaternion<f64>> {
    let q = quaternion([0, 1, 2, 3].map(|i| columns[i][k]));
    ((q.norm() - 1.0).abs() <= LENGTH).then(|| q / q.norm())
}

/// The slope in the middle of every step.
fn slope(e: &Evidence<'_>, at: usize, source: Source) -> Vec<f64> {
    let step_s = e.view.records[at].sample_time_s;
    match source {
        Source::Output(of, factor) => {
            let turn = match e.view.system.outputs[of].unit.as_deref() {
                Some("rad") => std::f64::consts::TAU,
                Some("deg") => 360.0,
                _ => f64::INFINITY,
            };
            // An angle that starts again from the other end has not moved.
            let step = |pair: &[f64]| match pair[1] - pair[0] {
                far if far.abs() > 0.5 * turn => far - turn * far.signum(),
                near => near,
            };
            samples(e, at, of).windows(2).map(|pair| step(pair) / (step_s * factor)).collect()
        }
        Source::Turning(of, axis) => {
            let columns = of.map(|i| samples(e, at, i));
            let turn = |k: usize| {
                let between = attitude(&columns, k)?.conjugate() * attitude(&columns, k + 1)?;
                let vector = between.vector();
                let size = vector.norm();
                // The shorter way round.
                let angle = 2.0 * size.atan2(between.w.abs()) * between.w.signum();
                Some(if size > 0.0 { vector[axis] / size * angle / step_s } else { 0.0 })
            };
            (0..columns[0].len().saturating_sub(1)).map(|k| turn(k).unwrap_or(f64::NAN)).collect()
        }
    }
}

fn parts(e: &Evidence<'_>, pair: &Pair) -> Vec<Part> {
    (0..e.view.records.len())
        .map(|at| Part {
            slope: slope(e, at, pair.source),
            rate: alike::middles(&samples(e, at, pair.rate)),
        })
        .collect()
}

impl Pair {
    fn words(&self, e: &Evidence<'_>) -> String {
        match self.source {
            Source::Output(of, factor) if factor < 0.0 => {
                format!("the slope of `{}` turned round", e.output(of))
            }
            Source::Output(of, _) => format!("the slope of `{}`", e.output(of)),
            Source::Turning(of, _) => {
                format!("the turning of `{}` to `{}`", e.output(of[0]), e.output(of[3]))
            }
        }
    }
}

/// The findings on sensors that may be axes of one vector: rotated axes first, otherwise each axis alone.
fn axes(e: &Evidence<'_>, group: &[Pair], turning: &Option<[Pair; 3]>, said: &mut Said) {
    let all: Vec<Vec<Part>> = group.iter().map(|p| parts(e, p)).collect();
    let lags = e.view.lags();
    let fits: Vec<Option<Alike>> = all.iter().map(|parts| alike::compare(parts, lags)).collect();
    let turned = in_body(e, group, &fits, turning).or_else(|| across(e, group, &all));
    if let Some(finding) = turned {
        let names: Vec<&str> = group.iter().map(|p| e.output(p.rate)).collect();
        said.found.push(result(CheckKind::Axes, &names.join(", "), Some(false), finding));
        return;
    }
    for (pair, fit) in group.iter().zip(&fits) {
        one(e, pair, *fit, group.len() == 1, said);
    }
}

/// Three velocities along the axes of a body whose attitude is logged, where the model has them along the world's.
fn in_body(
    e: &Evidence<'_>,
    group: &[Pair],
    fits: &[Option<Alike>],
    turning: &Option<[Pair; 3]>,
) -> Option<String> {
    let [Pair { source: Source::Turning(of, _), .. }, ..] = turning.as_ref()? else { return None };
    let [Pair { source: Source::Output(..), .. }, _, _] = group else { return None };
    let left = |fits: &[Option<Alike>]| {
        fits.iter().map(|f| 1.0 - f.map_or(0.0, |f| f.correlation)).fold(0.0, f64::max)
    };
    let logged = left(fits);
    if logged <= APART {
        return None;
    }
    let mut turned: Vec<Vec<Part>> = vec![Vec::new(); 3];
    for at in 0..e.view.records.len() {
        let columns = of.map(|i| samples(e, at, i));
        let rates: Vec<Vec<f64>> = group.iter().map(|p| samples(e, at, p.rate)).collect();
        let mut world = vec![vec![f64::NAN; rates[0].len()]; 3];
        for k in 0..rates[0].len() {
            if let Some(q) = attitude(&columns, k) {
                let v = Quaternion::new(0.0, rates[0][k], rates[1][k], rates[2][k]);
                let v = (q * v * q.conjugate()).vector().into_owned();
                (0..3).for_each(|i| world[i][k] = v[i]);
            }
        }
        for i in 0..3 {
            turned[i].push(Part {
                slope: slope(e, at, group[i].source),
                rate: alike::middles(&world[i]),
            });
        }
    }
    let fits: Vec<Option<Alike>> =
        turned.iter().map(|parts| alike::compare(parts, e.view.lags())).collect();
    let after = left(&fits);
    (after <= 1.0 - TOGETHER && after <= (1.0 - GAINED) * logged).then(|| {
        let names: Vec<String> = group.iter().map(|p| format!("`{}`", e.output(p.rate))).collect();
        format!(
            "{} are along the body's axes where the model has them along the world's: turned by the logged attitude they go with the slopes of the positions (correlation {} at least, {} as logged); turn them",
            names.join(", "),
            short(1.0 - after),
            short(1.0 - logged)
        )
    })
}

/// Rates regressed on the slopes of all axes: how far they are turned, where another axis has a part beyond chance.
fn across(e: &Evidence<'_>, group: &[Pair], all: &[Vec<Part>]) -> Option<String> {
    let n = group.len();
    if !(2..=3).contains(&n) {
        return None;
    }
    let rows = rows(all);
    if rows.len() < STRETCHES * 10 {
        return None;
    }
    let found = regression(&rows, n, None)?;
    let others: Vec<DMatrix<f64>> =
        (0..STRETCHES).filter_map(|out| regression(&rows, n, Some(out))).collect();
    let count = others.len() as f64;
    let spread = |i: usize, j: usize| {
        let mean = others.iter().map(|m| m[(i, j)]).sum::<f64>() / count;
        ((count - 1.0) / count * others.iter().map(|m| (m[(i, j)] - mean).powi(2)).sum::<f64>())
            .sqrt()
    };
    let explained = |i: usize| {
        let left: f64 = rows
            .iter()
            .map(|r| (r[n + i] - (0..n).map(|j| found[(i, j)] * r[j]).sum::<f64>()).powi(2))
            .sum();
        1.0 - left / rows.iter().map(|r| r[n + i].powi(2)).sum::<f64>()
    };
    let size = (0..n).map(|i| found.row(i).norm()).fold(0.0, f64::max);
    let part = |i: usize, j: usize| {
        found[(i, j)].abs() > ACROSS * size && found[(i, j)].abs() > CERTAIN * spread(i, j)
    };
    // One cross term alone may be a motion that another axis explains; a turn has two.
    let turned = (0..n)
        .any(|i| (0..i).any(|j| part(i, j) && part(j, i) && found[(i, j)] * found[(j, i)] < 0.0));
    let clear = (0..n).all(|i| explained(i) > TOGETHER * TOGETHER);
    if !turned || !clear || others.len() < STRETCHES {
        return None;
    }
    let angle = rotation_degrees(&found, size)?;
    let names = |of: &dyn Fn(&Pair) -> String| group.iter().map(of).collect::<Vec<_>>().join(", ");
    Some(format!(
        "{} are along other axes than {}: turned by {}°, which a factor would not explain; turn one of the two",
        names(&|p| format!("`{}`", e.output(p.rate))),
        names(&|p| p.words(e)),
        short(angle)
    ))
}

/// The coefficients of the rates of `n` axes on their slopes, by least squares without one stretch of the rows.
fn regression(rows: &[Vec<f64>], n: usize, left_out: Option<usize>) -> Option<DMatrix<f64>> {
    let (mut gram, mut right) = (DMatrix::<f64>::zeros(n, n), DMatrix::<f64>::zeros(n, n));
    for (_, row) in
        rows.iter().enumerate().filter(|(k, _)| Some(k * STRETCHES / rows.len()) != left_out)
    {
        let (x, y) = (DVector::from_column_slice(&row[..n]), DVector::from_column_slice(&row[n..]));
        gram += &x * x.transpose();
        right += &x * y.transpose();
    }
    Some(gram.cholesky()?.solve(&right).transpose())
}

/// The angle of the rotation nearest to coefficients of this size; `None` for a reflection.
fn rotation_degrees(coefficients: &DMatrix<f64>, size: f64) -> Option<f64> {
    let n = coefficients.nrows();
    let square = DMatrix::from_fn(3, 3, |i, j| {
        if i < n && j < n { coefficients[(i, j)] } else { size * f64::from(u8::from(i == j)) }
    });
    let svd = svd(&square)?;
    let turn = svd.u? * svd.v_t?;
    if turn.determinant() < 0.0 {
        return None;
    }
    Some((0.5 * (turn.trace() - 1.0)).clamp(-1.0, 1.0).acos().to_degrees())
}

/// Slopes and rates of all axes through one filter, the means of every log taken off, where all are there.
fn rows(all: &[Vec<Part>]) -> Vec<Vec<f64>> {
    let smooth = |x: &[f64]| alike::moving_mean(&alike::moving_mean(x, AXES), AXES);
    let mut rows = Vec::new();
    for at in 0..all.first().map_or(0, Vec::len) {
        let slopes = all.iter().map(|parts| smooth(&parts[at].slope));
        let columns: Vec<Vec<f64>> =
            slopes.chain(all.iter().map(|parts| smooth(&parts[at].rate))).collect();
        let there =
            (0..columns[0].len()).map(|k| columns.iter().map(|c| c[k]).collect::<Vec<f64>>());
        let mut own: Vec<Vec<f64>> =
            there.filter(|row| row.iter().all(|v| v.is_finite())).collect();
        let count = own.len() as f64;
        for i in 0..columns.len() {
            let mean = own.iter().map(|r| r[i]).sum::<f64>() / count;
            own.iter_mut().for_each(|r| r[i] -= mean);
        }
        rows.extend(own);
    }
    rows
}

/// A number with its interval.
fn range(known: Known) -> String {
    format!("{} (± {})", short(known.value.abs()), short(known.half))
}

/// The findings on one pair.
fn one(e: &Evidence<'_>, pair: &Pair, fit: Option<Alike>, alone: bool, said: &mut Said) {
    let (rate, words) = (e.output(pair.rate), pair.words(e));
    let Some(fit) = fit else {
        said.untold.push(format!("`{rate}` or {words} stands still, or too few samples are there"));
        return;
    };
    if fit.correlation.abs() < TOGETHER {
        said.untold.push(format!(
            "`{rate}` and {words} are weakly correlated (correlation {}): little motion, noise, or other axes",
            short(fit.correlation)
        ));
        return;
    }
    let compared = Compared::of(e, pair, fit);
    let findings = [
        (CheckKind::Unit, compared.gain(alone)),
        (CheckKind::ClockOffset, compared.lag()),
        (CheckKind::Unit, compared.offset()),
    ];
    let before = said.found.len();
    said.found.extend(
        findings
            .into_iter()
            .filter_map(|(kind, finding)| Some(result(kind, rate, Some(false), finding?))),
    );
    if before == said.found.len() && !compared.other_unit {
        let numbers = compared.numbers();
        if compared.is_vague() { said.untold.push(numbers) } else { said.agree.push(numbers) }
    }
}

/// Whether a number lies clearly outside its interval about 0, and beyond the least that matters.
fn excludes(known: Known, least: f64) -> bool {
    known.value.abs() > SURE * known.half && known.value.abs() > least
}

/// A rate compared with the slope of its source.
struct Compared<'c, 'e> {
    e: &'c Evidence<'e>,
    pair: &'c Pair,
    fit: Alike,
    /// The rate over the slope.
    factor: f64,
    /// A factor between units is named as such elsewhere, and so is a wrong sign.
    other_unit: bool,
    rate: &'c str,
    words: String,
}

impl<'c, 'e> Compared<'c, 'e> {
    fn of(e: &'c Evidence<'e>, pair: &'c Pair, fit: Alike) -> Self {
        let [low, high] = fit.factor;
        let factor = (low * high).sqrt();
        let other_unit = match pair.source {
            Source::Output(of, f) => {
                let relation = Relation { of, rate: pair.rate, factor: f };
                !unit::guesses(e, relation, 1.0 / factor).is_empty()
            }
            Source::Turning(..) => false,
        };
        let (rate, words) = (e.output(pair.rate), pair.words(e));
        Self { e, pair, fit, factor, other_unit, rate, words }
    }

    /// The finding on the factor: another one in another band, or a gain. `alone`: no other axis belongs to the pair.
    fn gain(&self, alone: bool) -> Option<String> {
        if self.other_unit {
            return None;
        }
        let Self { rate, words, factor, .. } = self;
        let [low, high] = self.fit.factor;
        if let Some([other, also]) = self.fit.elsewhere {
            return Some(format!(
                "`{rate}` is {} to {} times {words} where they agree best, {} to {} times in another band: a filter or a lag of one of the two, no gain",
                short(low),
                short(high),
                short(other),
                short(also)
            ));
        }
        let gain = Known { value: factor.ln(), half: 0.5 * (high / low).ln() };
        if !excludes(gain, (1.0 + FACTOR).ln()) {
            return None;
        }
        let axis = alone && *factor < 1.0 && matches!(self.pair.source, Source::Output(..));
        let or = if axis {
            format!(", or an axis that is {}° off", short(factor.min(1.0).acos().to_degrees()))
        } else {
            String::new()
        };
        // Matrices do not tell kinematics from numbers that may be wrong.
        let matrix = self.pair.stated && matches!(self.e.view.system.dynamics, Dynamics::Linear(_));
        let number = if matrix { ", or the model's own number between the two" } else { "" };
        Some(format!(
            "`{rate}` is {} times {words} (95 %: {} to {}): a gain of one of the two{or}{number}",
            short(*factor),
            short(low),
            short(high)
        ))
    }

    /// The finding on a rate that comes later or earlier than the slope.
    fn lag(&self) -> Option<String> {
        let (rate, words, lag) = (self.rate, &self.words, self.lag_s());
        let late = if lag.value > 0.0 { "later" } else { "earlier" };
        excludes(self.fit.lag, LATE).then(|| {
            format!(
                "`{rate}` comes {} s {late} than {words}: the clock, a filter or a bus of one of the two",
                range(lag)
            )
        })
    }

    /// The lag in seconds.
    fn lag_s(&self) -> Known {
        let (lag, ts) = (self.fit.lag, self.e.view.sample_time_s());
        Known { value: lag.value * ts, half: lag.half * ts }
    }

    /// The finding on a rate that stands above or below the slope.
    fn offset(&self) -> Option<String> {
        let Self { pair, fit, rate, words, .. } = self;
        if !pair.stated || self.other_unit || !excludes(fit.offset, OFFSET * fit.size) {
            return None;
        }
        let unit = self.e.view.system.outputs[pair.rate]
            .unit
            .as_deref()
            .map(|u| format!(" {u}"))
            .unwrap_or_default();
        let side = if fit.offset.value > 0.0 { "above" } else { "below" };
        Some(format!(
            "`{rate}` stands {}{unit} {side} {words}: an offset of one of the two",
            range(fit.offset)
        ))
    }

    /// Factor and lag with their intervals.
    fn numbers(&self) -> String {
        let ([low, high], lag) = (self.fit.factor, self.lag_s());
        format!(
            "`{}` is {} to {} times {}, {} s late (± {})",
            self.rate,
            short(low),
            short(high),
            self.words,
            short(lag.value),
            short(lag.half)
        )
    }

    /// Intervals so wide that a fault would not have shown.
    fn is_vague(&self) -> bool {
        let [low, high] = self.fit.factor;
        high > WIDE * low || self.fit.lag.half > VAGUE
    }
}
