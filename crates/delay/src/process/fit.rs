//! The output-error fit of a process model: poles and delay are searched, numerator and initial states eliminated.
//!
//! Source: Golub and Pereyra (2003), doi:10.1088/0266-5611/19/2/201, for the elimination (Kaufman's Jacobian). Björklund (2003), LiU-TEK-LIC-2003:60, p. 47,
//! for the cost as a function of the delay. The cost has one minimum per sampling interval, so whole samples are scanned and fractions descended.

pub(crate) mod several;

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::chain::{Chain, INPUT, LEAST_LAG, LEAST_RATIO, MOST_RATIO, REAL_RATIO, Row, Shape};
use crate::{bound, posterior};
use deadtime_identify::{Initial, Record, dot, lag_vector};
use deadtime_signal::fit::{Fit, LevenbergMarquardt, Normal, Stopped, polish};
use deadtime_signal::stop::Stop;

/// A delay of `lag` − `g` samples, g between 0 and 1: the states `lag` samples ago, advanced by `g` of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub(super) lag: usize,
    pub(super) g: f64,
}

impl Place {
    /// The place of a delay; at a whole sample the place just after the input change.
    pub(super) fn of(delay: f64) -> Self {
        let lag = delay.max(0.0).ceil();
        Self { lag: lag as usize, g: lag - delay.max(0.0) }
    }

    pub(super) fn delay(self) -> f64 {
        let lag = self.lag as f64;
        lag - self.g
    }
}

/// A model of one delay.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Found {
    pub(super) place: Place,
    pub(super) theta: Vec<f64>,
    /// Σ e².
    pub(super) cost: f64,
    pub(super) converged: bool,
}

/// One record: the constants of a search.
struct Work<'a> {
    u: &'a [f64],
    /// Further inputs that act through the same poles.
    others: Vec<&'a [f64]>,
    /// Zero where the mask excludes the row.
    y: Vec<f64>,
    /// 1 where the output is used, else 0; `None`: everywhere.
    mask: Option<Vec<f64>>,
}

/// Subtracts the mean of the used samples. With equal centring of all columns, every record has its own offset, fitted jointly (Frisch and Waugh, 1933,
/// doi:10.2307/1907330). The subtracted means of input and output match only where both were measured throughout.
fn centre(column: &mut [f64], mask: Option<&[f64]>) {
    let counted = mask.map_or(count(column.len()), |m| m.iter().sum());
    let mean = column.iter().sum::<f64>() / counted.max(1.0);
    match mask {
        None => column.iter_mut().for_each(|v| *v -= mean),
        Some(m) => column.iter_mut().zip(m).for_each(|(v, m)| *v -= m * mean),
    }
}

/// The response to one of several inputs, through poles of its own.
#[derive(Clone)]
struct Part {
    found: Found,
    /// Its share of the output, all records in a row.
    model: Vec<f64>,
}

/// The data and the model of a fit.
pub(super) struct Problem<'a> {
    shape: Shape,
    initial: Initial,
    max_delay: usize,
    records: Vec<Work<'a>>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    /// Σ y² over the used samples.
    pub(super) power: f64,
    /// Samples used.
    pub(super) samples: f64,
    /// The responses to all inputs, found one after the other, where there are several.
    parts: Vec<Part>,
    /// Σ e² of the best model without the first input; for one input Σ y².
    pub(super) without: f64,
    /// Cancellation: once set, every evaluation fails, so that every search ends.
    stop: Stop,
}

/// The signals of one evaluation, all records in a row.
pub(super) struct Signals {
    pub(super) residual: Vec<f64>,
    pub(super) model: Vec<f64>,
    /// Linear columns: the numerator's signals, then the initial states record by record.
    pub(super) linear: Vec<Vec<f64>>,
    /// Derivatives of the model by the poles, then by g.
    pub(super) slopes: Vec<Vec<f64>>,
    /// (linearᵀ·linear)⁻¹.
    pub(super) inverse: DMatrix<f64>,
    /// The weights of `linear`.
    pub(super) coefficients: DVector<f64>,
}

/// The columns that compose the output, all records in a row.
struct Columns {
    /// The numerators' signals, input by input, then the initial states, record by record.
    linear: Vec<Vec<f64>>,
    /// For each input: its numerator's slopes by each pole, then their time derivatives.
    other: Vec<Vec<f64>>,
    /// The slopes of each initial state by the poles.
    start_slopes: Vec<Vec<Vec<f64>>>,
}

impl<'a> Problem<'a> {
    /// One input.
    pub(super) fn new(
        shape: Shape,
        real: bool,
        initial: Initial,
        records: &'a [Record],
        max_delay: usize,
        stop: &Stop,
    ) -> Self {
        Self::together(shape, real, initial, records, &[], max_delay, stop)
    }

    /// The first input together with others, each a list of as many records. Poles are common; each input has its own numerator and delay. The delays of the
    /// others follow the parameters of D.
    pub(super) fn together(
        shape: Shape,
        real: bool,
        initial: Initial,
        records: &'a [Record],
        others: &'a [Vec<Record>],
        max_delay: usize,
        stop: &Stop,
    ) -> Self {
        let first = if initial == Initial::Estimated { max_delay } else { 0 };
        let work = |(number, r): (usize, &'a Record)| {
            let n = r.len();
            let others =
                others.iter().filter_map(|records| records.get(number)?.u.get(..n)).collect();
            let counts = |t: usize| t >= first && r.present.as_ref().is_none_or(|p| p[t]);
            let mask: Option<Vec<f64>> = (r.present.is_some() || first > 0)
                .then(|| (0..n).map(|t| f64::from(u8::from(counts(t)))).collect());
            let mut y: Vec<f64> = (0..n).map(|t| if counts(t) { r.y[t] } else { 0.0 }).collect();
            centre(&mut y, mask.as_deref());
            Work { u: &r.u[..n], others, y, mask }
        };
        let records: Vec<Work<'a>> = records.iter().enumerate().map(work).collect();
        let longest = records.iter().map(|w| w.u.len()).max().unwrap_or(0);
        let longest = (longest.max(2) as f64).ln();
        let (mut lower, mut upper) =
            (vec![LEAST_LAG.ln(); shape.denominator()], vec![longest; shape.denominator()]);
        if let Some(at) = shape.ratio() {
            lower[at] = LEAST_RATIO;
            upper[at] = if real { REAL_RATIO } else { MOST_RATIO };
        }
        lower.extend(others.iter().map(|_| 0.0));
        upper.extend(others.iter().map(|_| count(max_delay)));
        let power = records.iter().map(|w| dot(&w.y, &w.y)).sum();
        let samples = records
            .iter()
            .map(|w| w.mask.as_ref().map_or(count(w.u.len()), |m| m.iter().sum()))
            .sum();
        let mut problem = Self {
            shape,
            initial,
            max_delay,
            records,
            lower,
            upper,
            power,
            samples,
            parts: Vec::new(),
            without: power,
            stop: stop.clone(),
        };
        if !others.is_empty() {
            problem.parts = problem.one_after_the_other();
            problem.without = problem.of_others();
        }
        problem
    }

    /// Free parameters of a fit, the delay among them.
    pub(super) fn parameters(&self) -> usize {
        let starts = if self.initial == Initial::Estimated {
            self.shape.poles * self.records.len()
        } else {
            0
        };
        self.shape.denominator()
            + (self.shape.numerator() + 1) * (1 + self.others())
            + starts
            + self.records.len()
    }

    /// Delays are whole samples.
    pub(super) fn whole(&self) -> bool {
        self.shape.whole()
    }

    /// The longest delay.
    pub(super) fn longest(&self) -> f64 {
        count(self.max_delay)
    }

    /// A time constant is as long as the records.
    pub(super) fn integrates(&self, theta: &[f64]) -> bool {
        let poles = theta.iter().take(self.shape.denominator()).enumerate();
        poles.into_iter().any(|(i, v)| Some(i) != self.shape.ratio() && *v >= self.upper[i] - 1e-6)
    }

    /// The same with poles so fast that the longest record contains several of their time constants.
    pub(super) fn of_seen_poles(mut self) -> Self {
        let ratio = self.shape.ratio();
        let poles = self.shape.denominator();
        for (_, upper) in
            self.upper.iter_mut().take(poles).enumerate().filter(|(i, _)| Some(*i) != ratio)
        {
            *upper -= SEEN.ln();
        }
        self
    }

    /// Model, residual and derivatives at these poles and this delay.
    pub(super) fn signals(&self, theta: &[f64], place: Place) -> Option<Signals> {
        if self.stop.is_set() {
            return None;
        }
        let (theta, delays) = theta.split_at(self.shape.denominator().min(theta.len()));
        let places: Vec<Place> =
            std::iter::once(place).chain(delays.iter().map(|d| Place::of(*d))).collect();
        let columns = self.columns(theta, &places);
        let y: Vec<f64> = self.records.iter().flat_map(|w| w.y.iter().copied()).collect();
        let (inverse, coefficients) = project(&columns.linear, &y)?;
        let mut model = vec![0.0; y.len()];
        for (c, column) in coefficients.iter().zip(&columns.linear) {
            add(&mut model, *c, column);
        }
        let residual: Vec<f64> = y.iter().zip(&model).map(|(y, m)| y - m).collect();
        let slopes = self.slopes(&columns, &coefficients, places.len());
        Some(Signals { residual, model, linear: columns.linear, slopes, inverse, coefficients })
    }

    /// The columns of the output at these poles and delays.
    fn columns(&self, theta: &[f64], places: &[Place]) -> Columns {
        let k = self.shape.numerator();
        let chain = Chain::new(self.shape, theta);
        // The numerator's rows, those of their slopes by each pole, and those of their time derivatives.
        let mut rows: Vec<Row> = chain.basis.clone();
        rows.extend(chain.slopes.iter().flatten());
        rows.extend(chain.basis.iter().map(|r| chain.rate(r)));
        let rows: Vec<Vec<Row>> = places.iter().map(|p| chain.after(p.g, &rows)).collect();
        let more = rows.first().map_or(0, Vec::len) - k;
        let total: usize = self.records.iter().map(|w| w.u.len()).sum();
        let starts = if self.initial == Initial::Estimated {
            self.shape.poles * self.records.len()
        } else {
            0
        };
        let mut columns = Columns {
            linear: vec![vec![0.0; total]; k * places.len() + starts],
            other: vec![vec![0.0; total]; more * places.len()],
            start_slopes: vec![Vec::new(); starts],
        };
        let mut from = 0;
        for (number, work) in self.records.iter().enumerate() {
            let to = from..from + work.u.len();
            let inputs = std::iter::once(work.u).chain(work.others.iter().copied());
            for (input, ((rows, place), u)) in rows.iter().zip(places).zip(inputs).enumerate() {
                let states = chain.states(u, &[]);
                let columns = columns.linear[input * k..(input + 1) * k]
                    .iter_mut()
                    .chain(&mut columns.other[input * more..(input + 1) * more]);
                for (row, column) in rows.iter().zip(columns) {
                    let mask = work.mask.as_deref();
                    combine(row, &states, u, place.lag, mask, &mut column[to.clone()]);
                }
            }
            if starts > 0 {
                self.free_motion(&chain, work, to.clone(), number, &mut columns);
            }
            let every = columns.linear.iter_mut().chain(&mut columns.other);
            for column in every.chain(columns.start_slopes.iter_mut().flatten()) {
                centre(&mut column[to.clone()], work.mask.as_deref());
            }
            from = to.end;
        }
        columns
    }

    /// The contribution of each initial state of a record, and its slopes by the poles.
    fn free_motion(
        &self,
        chain: &Chain,
        work: &Work,
        to: Range<usize>,
        number: usize,
        columns: &mut Columns,
    ) {
        let first = self.max_delay.min(to.len());
        let still = vec![0.0; to.len() - first];
        let to = to.start + first..to.end;
        let mask = work.mask.as_ref().map(|m| &m[first..]);
        let numerators = columns.linear.len() - columns.start_slopes.len();
        for i in 0..self.shape.poles {
            let mut start = vec![0.0; self.shape.states()];
            start[i] = 1.0;
            let free = chain.states(&still, &start);
            let at = number * self.shape.poles + i;
            let column = &mut columns.linear[numerators + at];
            let total = column.len();
            combine(&chain.basis[0], &free, &still, 0, mask, &mut column[to.clone()]);
            for slope in &chain.slopes[0] {
                let mut column = vec![0.0; total];
                combine(slope, &free, &still, 0, mask, &mut column[to.clone()]);
                columns.start_slopes[at].push(column);
            }
        }
    }

    /// Derivatives of the model by the poles, by the delays of the others, by g.
    fn slopes(
        &self,
        columns: &Columns,
        coefficients: &DVector<f64>,
        inputs: usize,
    ) -> Vec<Vec<f64>> {
        let (k, poles) = (self.shape.numerator(), self.shape.denominator());
        let Columns { linear, other, start_slopes } = columns;
        let (numerators, more) = (k * inputs, other.len() / inputs);
        let total = linear.first().map_or(0, Vec::len);
        let mut slopes = vec![vec![0.0; total]; poles + inputs];
        for (i, c) in coefficients.iter().enumerate().take(numerators) {
            let (input, i) = (i / k, i % k);
            let own = &other[input * more..(input + 1) * more];
            for j in 0..poles {
                add(&mut slopes[j], *c, &own[i * poles + j]);
            }
            // A longer delay is a smaller g.
            let (at, sign) =
                if input == 0 { (poles + inputs - 1, 1.0) } else { (poles + input - 1, -1.0) };
            add(&mut slopes[at], sign * c, &own[k * poles + i]);
        }
        for (c, columns) in coefficients.iter().skip(numerators).zip(start_slopes) {
            for (slope, column) in slopes.iter_mut().zip(columns) {
                add(slope, *c, column);
            }
        }
        slopes
    }

    /// A gain alone, whose input is visible at the next sample: its lag and Σ e². A gain alone is the limit of a plant that settles within a sample, below the
    /// least time constant. The result is the best lag on both sides of a delay: a lag compensates a delay just short of a sample. `None` together with other
    /// inputs.
    pub(super) fn settled(&self, delay: f64) -> Option<(usize, f64)> {
        if self.others() > 0 {
            return None;
        }
        let y: Vec<f64> = self.records.iter().flat_map(|w| w.y.iter().copied()).collect();
        let cost = |lag: usize| {
            let mut column = Vec::with_capacity(y.len());
            for work in &self.records {
                let shown =
                    (0..work.u.len()).map(|t| t.checked_sub(lag).map_or(0.0, |at| work.u[at]));
                let mut shown: Vec<f64> = match &work.mask {
                    Some(mask) => shown.zip(mask).map(|(u, m)| m * u).collect(),
                    None => shown.collect(),
                };
                centre(&mut shown, work.mask.as_deref());
                column.append(&mut shown);
            }
            let gain = dot(&column, &y) / dot(&column, &column);
            gain.is_finite()
                .then(|| column.iter().zip(&y).map(|(u, y)| (y - gain * u).powi(2)).sum::<f64>())
        };
        let first = delay.max(0.0).floor() as usize;
        (first..first + 3)
            .filter_map(|lag| Some((lag, cost(lag)?)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The model's response to a unit pulse of one sample.
    pub(super) fn impulse(
        &self,
        theta: &[f64],
        place: Place,
        signals: &Signals,
        samples: usize,
    ) -> Vec<f64> {
        let pulse: Vec<f64> = (0..samples).map(|t| f64::from(u8::from(t == 0))).collect();
        answer(self.shape, theta, place, signals.coefficients.as_slice(), &pulse)
    }

    /// Cost, gradient and information by the poles, and by g if `fraction` is set.
    fn evaluate(&self, theta: &[f64], place: Place, fraction: bool) -> Option<Normal> {
        let inside = theta
            .iter()
            .zip(self.lower.iter().zip(&self.upper))
            .all(|(v, (l, u))| *v >= l - 1e-12 && *v <= u + 1e-12);
        if !inside || !(0.0..=1.0).contains(&place.g) {
            return None;
        }
        let signals = self.signals(theta, place)?;
        Some(signals.normal(theta.len() + usize::from(fraction)))
    }

    fn search(&self, fraction: bool, tolerance: f64) -> LevenbergMarquardt {
        let (mut lower, mut upper) = (self.lower.clone(), self.upper.clone());
        if fraction {
            lower.push(0.0);
            upper.push(1.0);
        }
        LevenbergMarquardt {
            max_iterations: 40,
            gradient_tolerance: tolerance,
            step_tolerance: tolerance,
            cost_floor: 1e-28 * self.power,
            lower,
            upper,
        }
    }

    /// The best poles at a fixed delay.
    pub(super) fn at(&self, theta: &[f64], place: Place) -> Option<Found> {
        let fit = self.search(false, FINE).minimise(theta, |p| self.evaluate(p, place, false));
        fit.normal.cost.is_finite().then(|| Found {
            place,
            theta: fit.parameters,
            cost: fit.normal.cost,
            converged: fit.stopped.converged(),
        })
    }

    /// Descends over poles and delay together; enters the next interval while the cost falls.
    fn descend(&self, theta: &[f64], place: Place, tolerance: f64) -> Option<Found> {
        let mut best = self.within(theta, place, tolerance)?;
        let (mut came_from, mut turns) = (None, 0);
        loop {
            let Place { lag, g } = best.place;
            // Below rounding, costs keep falling from one side of a whole sample to the other and back.
            if self.shape.whole() || best.cost <= posterior::ROUNDING * self.power {
                return Some(best);
            }
            let next = if g <= EDGE && lag < self.max_delay {
                Place { lag: lag + 1, g: 1.0 }
            } else if g >= 1.0 - EDGE && lag > 1 {
                Place { lag: lag - 1, g: 0.0 }
            } else {
                return Some(best);
            };
            turns += usize::from(came_from == Some(next.lag));
            if turns > TURNS {
                return Some(best);
            }
            came_from = Some(lag);
            match self.within(&best.theta, next, tolerance) {
                // A whole sample ends one interval and begins another: only a lower cost continues.
                Some(found) if found.cost < best.cost * (1.0 - 1e-9) => best = found,
                _ => return Some(best),
            }
        }
    }

    fn within(&self, theta: &[f64], place: Place, tolerance: f64) -> Option<Found> {
        let start: Vec<f64> = theta.iter().copied().chain([place.g]).collect();
        // A delay of zero has no fraction.
        if place.lag == 0 || self.shape.whole() {
            return self.at(theta, place);
        }
        let fit = self.search(true, tolerance).minimise(&start, |p| self.joint(p, place.lag));
        self.found(fit, place.lag)
    }

    fn joint(&self, p: &[f64], lag: usize) -> Option<Normal> {
        let (g, theta) = p.split_last()?;
        self.evaluate(theta, Place { lag, g: *g }, true)
    }

    fn found(&self, fit: Fit, lag: usize) -> Option<Found> {
        let (g, theta) = fit.parameters.split_last()?;
        let converged = fit.stopped.converged();
        fit.normal.cost.is_finite().then(|| Found {
            place: Place { lag, g: *g },
            theta: theta.to_vec(),
            cost: fit.normal.cost,
            converged,
        })
    }

    /// The minimum to full precision.
    pub(super) fn refine(&self, found: &Found) -> Found {
        let found = self
            .descend(&found.theta, found.place, FINE)
            .filter(|f| f.cost <= found.cost)
            .unwrap_or_else(|| found.clone());
        let lag = found.place.lag;
        if lag == 0 || self.shape.whole() {
            return found;
        }
        let start: Vec<f64> = found.theta.iter().copied().chain([found.place.g]).collect();
        let Some(normal) = self.joint(&start, lag) else { return found };
        let fit = Fit {
            parameters: start,
            normal,
            stopped: Stopped::Step,
            iterations: 0,
            last_change: 0.0,
        };
        let fit = polish(fit, |p| self.joint(p, lag));
        self.found(fit, lag).map_or(found.clone(), |f| Found { converged: found.converged, ..f })
    }

    /// The best poles at a fixed delay from `theta` and every start of the table. Some shapes need it because poles at one delay do not predict those at
    /// another.
    pub(super) fn afresh(&self, theta: &[f64], place: Place) -> Option<Found> {
        let starts = self.table().into_iter().chain([theta.to_vec()]);
        starts.filter_map(|theta| self.at(&theta, place)).min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// The lowest minima, best first. For long records the first part locates the local minima, and the whole record refines them: locating takes far fewer
    /// samples.
    pub(super) fn minima(&self, initial_delay: Option<f64>) -> Vec<Found> {
        if self.others() > 0 {
            return self.joint_minima();
        }
        let Some(first) = self.first_part() else { return self.all_minima(initial_delay) };
        let valleys = first.all_minima(initial_delay);
        if valleys.is_empty() {
            return self.all_minima(initial_delay);
        }
        let mut minima = Vec::new();
        for valley in valleys.into_iter().take(VALLEYS) {
            keep(&mut minima, self.descend(&valley.theta, valley.place, COARSE));
        }
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        minima
    }

    /// The first samples of each record, enough to separate the local minima. `None` where that is the whole record, or where commands move in them much less
    /// than later.
    fn first_part(&self) -> Option<Problem<'_>> {
        let total: usize = self.records.iter().map(|w| w.u.len()).sum();
        if total <= 2 * FIRST {
            return None;
        }
        let movement = |u: &[f64]| u.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f64>();
        let (mut moved, mut moves) = (0.0, 0.0);
        let mut work = |w: &Work<'_>| {
            let n = (w.u.len() * FIRST).div_ceil(total).max(FIRST / 4).min(w.u.len());
            moved += movement(&w.u[..n]);
            moves += movement(w.u);
            let mask = w.mask.as_ref().map(|m| m[..n].to_vec());
            let mut y = w.y[..n].to_vec();
            centre(&mut y, mask.as_deref());
            // Masked rows are 0.
            mask.iter().for_each(|m| y.iter_mut().zip(m).for_each(|(y, m)| *y *= m));
            (n, y, mask)
        };
        let parts: Vec<_> = self.records.iter().map(&mut work).collect();
        let records: Vec<Work<'_>> = self
            .records
            .iter()
            .zip(parts)
            .map(|(w, (n, y, mask))| Work { u: &w.u[..n], others: Vec::new(), y, mask })
            .collect();
        let used: usize = records.iter().map(|w| w.u.len()).sum();
        // At least half of the average motion per sample of the record.
        if moved * count(total) < 0.5 * moves * count(used) {
            return None;
        }
        let power = records.iter().map(|w| dot(&w.y, &w.y)).sum();
        let samples = records
            .iter()
            .map(|w| w.mask.as_ref().map_or(count(w.u.len()), |m| m.iter().sum()))
            .sum();
        let (lower, upper) = (self.lower.clone(), self.upper.clone());
        Some(Problem {
            records,
            power,
            samples,
            lower,
            upper,
            parts: Vec::new(),
            without: power,
            stop: self.stop.clone(),
            ..*self
        })
    }

    /// The same from all samples: descents from the best fits of a table of poles, over all delays.
    fn all_minima(&self, initial_delay: Option<f64>) -> Vec<Found> {
        let row =
            |theta: Vec<f64>| (!self.stop.is_set()).then(|| (theta.clone(), self.profile(&theta)));
        let Some(table) =
            self.table().into_iter().map(row).collect::<Option<Vec<(Vec<f64>, CostProfile)>>>()
        else {
            return Vec::new();
        };
        let places = table.first().map_or(0, |(_, profile)| profile.len());
        // The lower envelope over the table, and the poles that give it.
        let envelope: Vec<(usize, f64)> = (0..places)
            .filter_map(|at| {
                table
                    .iter()
                    .enumerate()
                    .map(|(i, (_, p))| (i, p[at].1))
                    .filter(|(_, c)| c.is_finite())
                    .min_by(|a, b| a.1.total_cmp(&b.1))
            })
            .collect();
        if envelope.len() < places || places == 0 {
            return Vec::new();
        }
        let cost = |at: usize| envelope[at].1;
        let mut starts: Vec<(f64, usize, usize)> = (0..places)
            .filter(|&at| {
                (at == 0 || cost(at) <= cost(at - 1))
                    && (at + 1 == places || cost(at) <= cost(at + 1))
            })
            .map(|at| (cost(at), envelope[at].0, at))
            .collect();
        // Each row of the table at its best delay.
        starts.extend(table.iter().enumerate().filter_map(|(i, (_, p))| {
            p.iter()
                .enumerate()
                .filter(|(_, (_, c))| c.is_finite())
                .min_by(|a, b| a.1.1.total_cmp(&b.1.1))
                .map(|(at, (_, c))| (*c, i, at))
        }));
        starts.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        starts.dedup_by_key(|s| (s.1, s.2));
        starts.truncate(STARTS);
        if let Some(delay) = initial_delay {
            let last = table.first().map_or(0, |(_, p)| p.len() - 1);
            let at = (0..=last).min_by(|&a, &b| {
                let away = |i: usize| (table[0].1[i].0.delay() - delay).abs();
                away(a).total_cmp(&away(b))
            });
            starts.extend(at.map(|at| (cost(at), envelope[at].0, at)));
        }
        let mut minima: Vec<Found> = Vec::new();
        for (_, row, at) in starts {
            let (theta, profile) = &table[row];
            keep(&mut minima, self.descend(theta, profile[at].0, COARSE));
        }
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        minima
    }

    /// Poles close to most plants, from a fraction of a sample to half the longest record.
    fn table(&self) -> Vec<Vec<f64>> {
        let most = self.upper[0].exp() / 2.0;
        let lags: Vec<f64> = LAGS.into_iter().filter(|l| *l <= most.max(1.0)).collect();
        let mut table = Vec::new();
        if self.shape.poles == 1 {
            return lags.iter().map(|l| vec![l.ln()]).collect();
        }
        let mut pairs = Vec::new();
        for (i, a) in lags.iter().enumerate() {
            for b in &lags[..=i] {
                pairs.push(vec![(a + b).ln(), a * b / (a + b).powi(2)]);
            }
        }
        let at = self.shape.ratio().unwrap_or(0);
        if self.upper[at] > REAL_RATIO {
            // T and ζ of resonances.
            for t in lags.iter().filter(|l| **l >= 0.5) {
                pairs.extend(
                    [0.5, 0.15].map(|zeta: f64| vec![(2.0 * zeta * t).ln(), 0.25 / (zeta * zeta)]),
                );
            }
        }
        for pair in pairs {
            if self.shape.poles == 2 {
                table.push(pair);
            } else {
                // The third time constant equal to the sum of the others, and to 25 % of it.
                table.extend(
                    [1.0, 0.25].map(|share: f64| vec![pair[0], pair[1], pair[0] + share.ln()]),
                );
            }
        }
        for theta in &mut table {
            for (v, (l, u)) in theta.iter_mut().zip(self.lower.iter().zip(&self.upper)) {
                *v = v.clamp(*l, *u);
            }
        }
        table
    }

    /// The cost at every half sample for given poles, from one filter pass and its correlations with the output. Initial states other than rest are left out.
    fn profile(&self, theta: &[f64]) -> CostProfile {
        let chain = Chain::new(self.shape, theta);
        let lags = self.max_delay + 1;
        // Only the states before the derivatives' own, and the input.
        let used: Vec<usize> = (0..self.shape.poles)
            .map(|i| if self.shape.poles == 1 { 0 } else { i })
            .chain([INPUT])
            .collect();
        let width = used.len();
        let mut right = vec![DVector::<f64>::zeros(width); lags];
        let mut gram = vec![DMatrix::<f64>::zeros(width, width); lags];
        for work in &self.records {
            let n = work.u.len();
            let states = chain.states(work.u, &[]);
            let signal =
                |i: usize| if used[i] == INPUT { work.u } else { states[used[i]].as_slice() };
            for i in 0..width {
                for (lag, value) in lag_vector(&work.y, signal(i), lags).into_iter().enumerate() {
                    right[lag][i] += value;
                }
                for j in 0..=i {
                    let (a, b) = (signal(i), signal(j));
                    let mut energy = if work.mask.is_none() { dot(a, b) } else { 0.0 };
                    for (lag, gram) in gram.iter_mut().enumerate().take(n) {
                        let value = match &work.mask {
                            None => energy,
                            Some(m) => m[lag..]
                                .iter()
                                .zip(a.iter().zip(b))
                                .map(|(m, (a, b))| m * a * b)
                                .sum(),
                        };
                        gram[(i, j)] += value;
                        if i != j {
                            gram[(j, i)] += value;
                        }
                        energy -= a[n - 1 - lag] * b[n - 1 - lag];
                    }
                }
            }
        }
        let mut profile = Vec::with_capacity(2 * lags - 1);
        let fractions: &[f64] = if self.shape.whole() { &[0.0] } else { &[0.0, 0.5] };
        for &g in fractions {
            let rows = chain.after(g, &chain.basis);
            let rows = DMatrix::from_fn(rows.len(), width, |i, j| rows[i][used[j]]);
            for lag in usize::from(g > 0.0)..lags {
                let small = &rows * &gram[lag] * rows.transpose();
                let target = &rows * &right[lag];
                let explained = ridged(small).map_or(f64::NAN, |c| c.solve(&target).dot(&target));
                profile.push((Place { lag, g }, self.power - explained));
            }
        }
        profile.sort_by(|a, b| a.0.delay().total_cmp(&b.0.delay()));
        profile
    }
}

/// Adds a minimum, unless a lower one is at the same delay.
fn keep(minima: &mut Vec<Found>, found: Option<Found>) {
    let Some(found) = found else { return };
    match minima.iter_mut().find(|m| (m.place.delay() - found.place.delay()).abs() < 0.25) {
        Some(known) if known.cost <= found.cost => {}
        Some(known) => *known = found,
        None => minima.push(found),
    }
}

/// Costs by delay, in the order of the delays.
type CostProfile = Vec<(Place, f64)>;

/// Tolerance of a search for the valley of a minimum.
const COARSE: f64 = 1e-5;
/// Tolerance of a search for the minimum itself.
const FINE: f64 = 1e-8;
/// Record length in time constants from which a pole is visible.
const SEEN: f64 = 10.0;
/// A fraction within this distance of a whole sample equals it.
const EDGE: f64 = 1e-6;
/// Samples that separate local minima; longer records are first searched in this many.
const FIRST: usize = 6000;
/// Local minima of the first part that are tested on the whole.
const VALLEYS: usize = 6;
/// Largest number of returns to the previous interval: a minimum at a whole sample is visible from both sides.
const TURNS: usize = 4;
/// Number of descents; additional starts at every half sample found nothing lower in 94 of 96 random plants (tests/process.rs).
const STARTS: usize = 12;
/// Time constants of the table, samples: half a decade apart, as costs vary slowly with the logarithm.
const LAGS: [f64; 8] = [0.1, 0.6, 2.0, 5.0, 12.0, 30.0, 100.0, 1000.0];

fn count(n: usize) -> f64 {
    n as f64
}

/// A model's response to an input, from rest; `coefficients` of its numerator.
pub(super) fn answer(
    shape: Shape,
    theta: &[f64],
    place: Place,
    coefficients: &[f64],
    u: &[f64],
) -> Vec<f64> {
    let chain = Chain::new(shape, &theta[..shape.denominator().min(theta.len())]);
    let states = chain.states(u, &[]);
    let mut response = vec![0.0; u.len()];
    for (row, c) in chain.after(place.g, &chain.basis).iter().zip(coefficients) {
        let mut part = vec![0.0; u.len()];
        combine(row, &states, u, place.lag, None, &mut part);
        add(&mut response, *c, &part);
    }
    response
}

/// to(t) = mask(t)·Σ row·(states, u)(t − lag), zero before the record.
pub(super) fn combine(
    row: &Row,
    states: &[Vec<f64>],
    u: &[f64],
    lag: usize,
    mask: Option<&[f64]>,
    to: &mut [f64],
) {
    let n = to.len();
    let (before, after) = to.split_at_mut(lag.min(n));
    let length = after.len();
    before.fill(0.0);
    let signals = row.iter().zip(states.iter().map(Vec::as_slice)).chain([(&row[INPUT], u)]);
    let mut terms = signals.filter(|(c, _)| **c != 0.0).map(|(c, signal)| (*c, &signal[..length]));
    match terms.next() {
        Some((c, first)) => after.iter_mut().zip(first).for_each(|(to, x)| *to = c * x),
        None => after.fill(0.0),
    }
    while let Some((c, x)) = terms.next() {
        match terms.next() {
            // Two at a time: half of the memory accesses.
            Some((d, y)) => {
                after.iter_mut().zip(x).zip(y).for_each(|((to, x), y)| *to = (*to + c * x) + d * y)
            }
            None => add(after, c, x),
        }
    }
    for (v, m) in to.iter_mut().zip(mask.unwrap_or_default()) {
        *v *= m;
    }
}

fn add(to: &mut [f64], c: f64, x: &[f64]) {
    for (to, x) in to.iter_mut().zip(x) {
        *to += c * x;
    }
}

/// A relative ridge of rounding size: columns may coincide, only their sum matters.
fn ridged(mut gram: DMatrix<f64>) -> Option<nalgebra::Cholesky<f64, nalgebra::Dyn>> {
    for i in 0..gram.nrows() {
        gram[(i, i)] += 1e-13 * gram[(i, i)] + f64::MIN_POSITIVE;
    }
    gram.cholesky()
}

/// Least squares on the columns.
pub(super) fn project(columns: &[Vec<f64>], y: &[f64]) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let k = columns.len();
    let mut gram = DMatrix::zeros(k, k);
    for i in 0..k {
        for j in 0..=i {
            gram[(i, j)] = dot(&columns[i], &columns[j]);
            gram[(j, i)] = gram[(i, j)];
        }
    }
    let factor = ridged(gram)?;
    let coefficients = factor.solve(&DVector::from_fn(k, |i, _| dot(&columns[i], y)));
    coefficients.iter().all(|c| c.is_finite()).then(|| (factor.inverse(), coefficients))
}

impl Signals {
    /// Cost, gradient and information by the first `count` of the slopes, with the linear part projected out.
    pub(super) fn normal(&self, count: usize) -> Normal {
        let slopes = &self.slopes[..count];
        let cross =
            DMatrix::from_fn(self.linear.len(), count, |i, j| dot(&self.linear[i], &slopes[j]));
        let mut information = DMatrix::zeros(count, count);
        for i in 0..count {
            for j in 0..=i {
                information[(i, j)] = dot(&slopes[i], &slopes[j]);
                information[(j, i)] = information[(i, j)];
            }
        }
        information -= cross.transpose() * &self.inverse * &cross;
        // The residual falls as the model rises.
        let gradient = DVector::from_fn(count, |i, _| -dot(&slopes[i], &self.residual));
        Normal { cost: dot(&self.residual, &self.residual), gradient, information }
    }

    /// ∂ŷ/∂g with all other parameters known.
    pub(super) fn by_delay(&self) -> &[f64] {
        self.slopes.last().map_or(&[], Vec::as_slice)
    }

    /// ∂ŷ/∂g with all other derivatives projected out: the information on the delay given unknown gain, poles and initial state.
    pub(super) fn alone(&self) -> Option<Vec<f64>> {
        let (last, poles) = self.slopes.split_last()?;
        Some(bound::alone(last, self.linear.iter().chain(poles).map(Vec::as_slice)))
    }
}
