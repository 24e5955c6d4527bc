//! The law of random delays: their spread by the marginal likelihood, and whether disturbances of the input are more likely.

use super::arrival_equations::{Linear, information, solve};
use super::penalised_gain::NO_EVIDENCE;
use super::queue::{Waiting, waiting_for};
use deadtime_model::effect::Applied;
use deadtime_model::simulate::{Delays, Late};
use deadtime_signal::parallel;

/// Spreads that are tried, as parts of the mean delay: from, to, and how many.
const SPREADS: (f64, f64, usize) = (0.03, 1.5, 9);
/// Around the last one: neighbours by this factor.
const NEIGHBOUR: f64 = 1.3;
/// Halvings of this step's logarithm at the end: the last one is 1.7 %.
const HALVINGS: i32 = 4;

/// The spreads that are tried about a mean wait.
fn spreads(wait_s: f64) -> Vec<f64> {
    let (from, to, count) = SPREADS;
    let at = |i: usize| wait_s * from * (to / from).powf(i as f64 / (count - 1) as f64);
    (0..count).map(at).collect()
}

/// Whether disturbances of equal size explain more than independent delays of one distribution, about a common delay.
pub(super) fn is_disturbance(records: &[Linear], wait_s: f64) -> bool {
    let squares: Vec<f64> = records.iter().flat_map(|r| r.changes.iter().map(|c| c * c)).collect();
    let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    let equal: Vec<Linear> = records.iter().map(|r| r.of_equal_disturbances(rms)).collect();
    let lowest = |records: &[Linear]| {
        let independent = |std_s| Waiting { mean_s: wait_s, std_s, alike: 0.0 };
        let cost = |s| Some(solve(records, &independent(s))?.cost);
        let costs = parallel::filter_map(spreads(wait_s), cost).into_iter();
        costs.filter(|cost| cost.is_finite()).fold(f64::INFINITY, f64::min)
    };
    lowest(&equal) + NO_EVIDENCE < lowest(records)
}

/// The law with the lowest cost, with the mean wait that is given; spreads from small to large, then neighbours of the best.
pub(super) fn spread(
    records: &[Linear],
    late: &Applied,
    wait_s: f64,
    step_s: f64,
    first: bool,
) -> Option<(Late, Waiting)> {
    let lowest = |tried| lowest(records, tried, (wait_s, step_s), is_ordered(late));
    let all = || lowest(spreads(wait_s));
    let spread_s = if first { all()?.0.spread_s } else { late.values[1] };
    lowest(around(spread_s, NEIGHBOUR)).or_else(all)
}

fn around(spread_s: f64, by: f64) -> Vec<f64> {
    [by.recip(), 1.0, by].into_iter().map(|by| by * spread_s).collect()
}

/// The one of these spreads with the lowest cost, about a mean wait of commands that are sent every `step_s`.
fn lowest(
    records: &[Linear],
    spreads: Vec<f64>,
    (wait_s, step_s): (f64, f64),
    ordered: bool,
) -> Option<(Late, Waiting)> {
    let tried = |s| {
        let law = waiting_for(wait_s, s, ordered, step_s)?;
        Some((solve(records, &law.1)?.cost, law))
    };
    let costs: Vec<(f64, (Late, Waiting))> = parallel::filter_map(spreads, tried);
    costs
        .into_iter()
        .filter(|(cost, _)| cost.is_finite())
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, law)| law)
}

/// The law about delays that are known, and the standard deviations of its mean and its spread.
pub(super) struct Settled {
    pub(super) law: Late,
    pub(super) std: Vec<f64>,
}

impl Settled {
    /// With the spread between those that were tried before: the steps around the best are halved until they are small against the spread's uncertainty.
    pub(super) fn of(records: &[Linear], late: &Applied, step_s: f64) -> Option<Self> {
        let ordered = is_ordered(late);
        let about = (waits(late, step_s)?.mean_s, step_s);
        let mut best = lowest(records, vec![late.values[1]], about, ordered)?;
        for halving in 1..=HALVINGS {
            let by = NEIGHBOUR.powf(0.5_f64.powi(halving));
            best = lowest(records, around(best.0.spread_s, by), about, ordered).unwrap_or(best);
        }
        let (law, waiting) = best;
        let solved = solve(records, &waiting)?;
        let information = information(records, &waiting)?;
        let with = |spread_s| waiting_for(solved.mean_s, spread_s, ordered, step_s);
        let law = with(law.spread_s).map_or(law, |(law, _)| law);
        let spread_std = law.spread_s / (2.0 * information.spread).sqrt();
        // Commands that keep their order wait longer the more their delays vary: of one mean wait the mean delay depends on the spread.
        let moved = with(law.spread_s + spread_std)
            .or_else(|| with(law.spread_s - spread_std))
            .map_or(0.0, |(moved, _)| moved.delay_s - law.delay_s);
        let mean_std = solved.precision.sqrt().recip().hypot(moved);
        Some(Self { law, std: vec![mean_std, spread_std] })
    }
}

fn is_ordered(late: &Applied) -> bool {
    late.values[2] >= 0.5
}

/// The waits under a law that is known.
pub(super) fn waits(late: &Applied, step_s: f64) -> Option<Waiting> {
    Waiting::of(
        &Late {
            delay_s: late.values[0],
            spread_s: late.values[1],
            ordered: is_ordered(late),
            delays: Delays::Mean,
        },
        step_s,
    )
}
