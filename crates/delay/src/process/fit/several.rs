//! Several inputs: each fitted to the residual of the others, then all with common poles.

use crate::posterior;
use crate::process::chain::Shape;
use crate::process::fit::{
    COARSE, Found, Part, Problem, VALLEYS, Work, add, answer, keep, project,
};
use deadtime_identify::dot;

/// An input's own model, for any record of that input.
pub(in crate::process) struct Own {
    shape: Shape,
    found: Found,
    coefficients: Vec<f64>,
    /// The share of the output's power caused by the input.
    pub(in crate::process) share: f64,
}

impl Own {
    /// The response to the input, from rest.
    pub(in crate::process) fn answer(&self, u: &[f64]) -> Vec<f64> {
        answer(self.shape, &self.found.theta, self.found.place, &self.coefficients, u)
    }
}

/// Largest number of passes in which each input is fitted to the residual of the others.
const TURNS_OF_INPUTS: usize = 40;
/// After these passes a descent starts only at the previous fit.
const SEARCHED: usize = 4;
/// The passes end when one lowers the remaining cost by less than this share.
const SETTLED: f64 = 1e-6;

impl<'a> Problem<'a> {
    /// Inputs other than the first.
    pub(super) fn others(&self) -> usize {
        self.records.first().map_or(0, |w| w.others.len())
    }

    /// The output minus the responses to every input but this one.
    fn output_of(&self, input: usize, parts: &[Option<Part>]) -> Vec<f64> {
        let mut y: Vec<f64> = self.records.iter().flat_map(|w| w.y.iter().copied()).collect();
        for (_, part) in parts.iter().enumerate().filter(|(i, _)| *i != input) {
            if let Some(part) = part {
                add(&mut y, -1.0, &part.model);
            }
        }
        y
    }

    /// One input alone, with `y` as the output.
    fn single(&self, input: usize, y: &[f64]) -> Problem<'a> {
        let mut from = 0;
        let work = |w: &Work<'a>| {
            let n = w.u.len();
            let u = if input == 0 { w.u } else { w.others.get(input - 1).copied().unwrap_or(w.u) };
            let part = y.get(from..from + n).unwrap_or_default().to_vec();
            from += n;
            Work { u, others: Vec::new(), y: part, mask: w.mask.clone() }
        };
        let records: Vec<Work<'a>> = self.records.iter().map(work).collect();
        let power = records.iter().map(|w| dot(&w.y, &w.y)).sum();
        let poles = self.shape.denominator();
        Problem {
            records,
            power,
            without: power,
            parts: Vec::new(),
            lower: self.lower.iter().take(poles).copied().collect(),
            upper: self.upper.iter().take(poles).copied().collect(),
            stop: self.stop.clone(),
            ..*self
        }
    }

    /// The response of an output to an input, starting at the previous fit where one exists.
    fn part(&self, input: usize, y: &[f64], from: Option<&Found>) -> Option<Part> {
        let problem = self.single(input, y);
        let found = match from {
            Some(from) => problem.descend(&from.theta, from.place, COARSE)?,
            None => problem.refine(problem.minima(None).first()?),
        };
        let model = problem.signals(&found.theta, found.place)?.model;
        Some(Part { found, model })
    }

    /// Gains of all parts together: with correlated inputs, separate passes converge slowly.
    fn weigh(&self, parts: &mut [Option<Part>]) {
        let columns: Vec<Vec<f64>> = parts.iter().flatten().map(|p| p.model.clone()).collect();
        let y = self.output_of(parts.len(), &[]);
        let Some((_, gains)) = project(&columns, &y).filter(|_| !columns.is_empty()) else {
            return;
        };
        for (part, gain) in parts.iter_mut().flatten().zip(gains.iter()) {
            part.model.iter_mut().for_each(|v| *v *= gain);
        }
    }

    /// The response to each input, each fitted to the residual of the others, until convergence.
    ///
    /// Source: Breiman and Friedman (1985), J. Am. Stat. Assoc. 80(391), 580-598, doi:10.1080/01621459.1985.10478157, for the passes (backfitting).
    pub(super) fn one_after_the_other(&self) -> Vec<Part> {
        let inputs = 1 + self.others();
        let mut parts: Vec<Option<Part>> = vec![None; inputs];
        let mut last = f64::INFINITY;
        for turn in 0..TURNS_OF_INPUTS {
            for input in 0..inputs {
                let y = self.output_of(input, &parts);
                // The local minima are known by then.
                let from = parts
                    .get(input)
                    .and_then(Option::as_ref)
                    .filter(|_| turn > SEARCHED)
                    .map(|p| p.found.clone());
                if let Some(part) = self.part(input, &y, from.as_ref()) {
                    parts[input] = Some(part);
                }
            }
            self.weigh(&mut parts);
            let left = self.output_of(inputs, &parts);
            let cost = dot(&left, &left);
            if cost > (1.0 - SETTLED) * last && turn > SEARCHED {
                break;
            }
            last = cost;
        }
        parts.into_iter().collect::<Option<Vec<Part>>>().unwrap_or_default()
    }

    /// Σ e² without the first input: the others are refitted to the whole output.
    pub(super) fn of_others(&self) -> f64 {
        let mut parts: Vec<Option<Part>> = self.parts.iter().cloned().map(Some).collect();
        if parts.is_empty() {
            return self.power;
        }
        parts[0] = None;
        for input in 1..parts.len() {
            let y = self.output_of(input, &parts);
            if let Some(part) = self.part(input, &y, None) {
                parts[input] = Some(part);
            }
        }
        let left = self.output_of(parts.len(), &parts);
        dot(&left, &left)
    }

    /// Σ e² of the models with poles of their own; `None` for one input.
    pub(in crate::process) fn apart(&self) -> Option<f64> {
        let parts: Vec<Option<Part>> = self.parts.iter().cloned().map(Some).collect();
        let left = self.output_of(parts.len(), &parts);
        (!parts.is_empty()).then(|| dot(&left, &left))
    }

    /// The own model of every input whose removal raises the cost significantly.
    pub(in crate::process) fn acting(&self) -> Vec<Option<Own>> {
        let parts: Vec<Option<Part>> = self.parts.iter().cloned().map(Some).collect();
        let left = self.output_of(parts.len(), &parts);
        let (cost, floor) = (dot(&left, &left), posterior::ROUNDING * self.power);
        let needed = posterior::visible_gain(
            self.shape.denominator() + self.shape.numerator(),
            self.max_delay + 1,
        );
        let own = |(input, part): (usize, &Part)| {
            let y = self.output_of(input, &parts);
            let under = if cost <= floor {
                1.0
            } else {
                posterior::samples_under(&part.model, &left) / left.len().max(1) as f64
            };
            let gain =
                self.samples * under * (dot(&y, &y) / cost.max(floor).max(f64::MIN_POSITIVE)).ln();
            let single = self.single(input, &y);
            let signals =
                single.signals(&part.found.theta, part.found.place).filter(|_| gain >= needed)?;
            let share = dot(&signals.model, &signals.model) / self.power.max(f64::MIN_POSITIVE);
            Some(Own {
                shape: self.shape,
                found: part.found.clone(),
                coefficients: signals.coefficients.as_slice().to_vec(),
                share,
            })
        };
        self.parts.iter().enumerate().map(own).collect()
    }

    /// The first input alone; the responses to the others through their own poles are subtracted from the output.
    pub(in crate::process) fn behind_others(&self) -> Problem<'a> {
        let parts: Vec<Option<Part>> = self.parts.iter().cloned().map(Some).collect();
        self.single(0, &self.output_of(0, &parts))
    }

    /// Minima of several inputs with common poles, best first; the starts are the poles and delays of each input alone.
    pub(super) fn joint_minima(&self) -> Vec<Found> {
        let Some((first, others)) = self.parts.split_first() else { return Vec::new() };
        let valleys = self.behind_others().minima(None);
        let delays = || others.iter().map(|p| p.found.place.delay());
        let start = |theta: &[f64]| -> Vec<f64> { theta.iter().copied().chain(delays()).collect() };
        let mut minima = Vec::new();
        for part in &self.parts {
            keep(&mut minima, self.descend(&start(&part.found.theta), first.found.place, COARSE));
        }
        for valley in valleys.iter().take(VALLEYS) {
            keep(&mut minima, self.descend(&start(&valley.theta), valley.place, COARSE));
        }
        minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        minima
    }

    /// Parameters that the first input adds to the others.
    pub(in crate::process) fn added(&self) -> usize {
        if self.parts.is_empty() {
            self.parameters() - 1
        } else {
            self.shape.denominator() + self.shape.numerator()
        }
    }

    /// Parameters that separate poles for each input would add.
    pub(in crate::process) fn apart_adds(&self) -> usize {
        self.shape.denominator() * self.others()
    }
}
