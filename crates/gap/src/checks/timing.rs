//! The lag of the measured outputs behind the modelled ones, for the whole log and for every stretch.

use nalgebra::{DMatrix, DVector};

use super::faults::{Search, agrees};
use super::moments::{correlation, mean};
use super::view::View;

/// Stretches per log for the search of a lag.
const STRETCHES: usize = 12;
/// of at least so many samples.
const SHORTEST: usize = 80;
/// A lag counts where the correlation at it is at least this.
const CLEAR: f64 = 0.8;
/// A stretch counts where the model moves by at least this part of its mean square.
const MOVES: f64 = 0.1;
/// The least number of stretches for an estimate of their scatter.
const FEWEST: usize = 5;
/// Samples at either end beyond the reach of all filters, in addition to the searched lags.
const EDGE: usize = 18;
/// The term added to the diagonal of equal columns' products.
const RIDGE: f64 = 1e-9;
/// Samples per fitted column, so that commands without effect explain at most 10 % of the residual.
const FEWEST_PER_COLUMN: usize = 10;
/// Taps of a general linear correction, samples.
const TAPS: [isize; 11] = [-16, -8, -4, -2, -1, 0, 1, 2, 4, 8, 16];

/// How late an output is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Timing {
    /// Samples that the log comes after the model, in the middle of the logs.
    pub(super) lag: f64,
    pub(super) std: f64,
    /// The lag's growth, samples per sample.
    pub(super) growth: f64,
    pub(super) growth_std: f64,
    /// The part of the lags' variance over the stretches that a straight line explains.
    pub(super) straight: f64,
    /// Samples of the longest log.
    pub(super) length: f64,
    /// The misfit reduction by the lag alone, over that by any short linear filter: 1 where timing is the only fault.
    pub(super) pure: f64,
    /// The part of the residual after present and past commands that future commands explain. 0 where the output does not lead, and where the samples are too
    /// few for all commands. Also 0 where the model is predicted: feedback has the same signature.
    pub(super) ahead: f64,
}

impl Timing {
    /// The lag differs from 0 by four standard deviations, and by more than the error of the interpolation between samples.
    pub(super) fn is_late(&self) -> bool {
        self.lag.abs() > (4.0 * self.std).max(0.15)
    }

    /// The lag is so well known that a sample more or less would be seen.
    pub(super) fn is_sharp(&self) -> bool {
        self.std < 0.1
    }
}

/// One stretch: its middle (samples from the log's start), lag and weight.
struct Stretch {
    middle: f64,
    lag: f64,
    weight: f64,
}

/// The lag at which the correlation is largest, by the parabola through it and its neighbours.
fn lag_of(samples: &[usize], y: &[f64], x: &[f64], around: isize, range: isize) -> Option<f64> {
    let at = |lag: isize| correlation(&[(samples, y, x)], lag).map(|c| c.0);
    let best = (around - range..=around + range)
        .filter_map(|lag| Some((lag, at(lag)?)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    if best.1 < CLEAR || (best.0 - around).abs() == range {
        return None;
    }
    let (before, after) = (at(best.0 - 1)?, at(best.0 + 1)?);
    let bend = before - 2.0 * best.1 + after;
    (bend < 0.0).then(|| best.0 as f64 + 0.5 * (before - after) / bend)
}

/// Per output; `None` where the lag cannot be measured.
pub(super) fn measure(view: &View<'_>, search: &Search) -> Vec<Option<Timing>> {
    (0..view.outputs())
        .map(|i| if view.is_even() { of_output(view, search, i) } else { None })
        .collect()
}

fn of_output(view: &View<'_>, search: &Search, output: usize) -> Option<Timing> {
    let fit = search.fits.get(output).copied().flatten().filter(agrees)?;
    let range = isize::try_from(view.lags()).ok()?;
    let mut stretches: Vec<Stretch> = Vec::new();
    for at in 0..view.records.len() {
        let (y, x) =
            (search.measured[at][output].as_slice(), search.modelled[at][output].as_slice());
        let usable = view.usable(at, output);
        let size = (usable.len() / STRETCHES).max(SHORTEST);
        for samples in usable.chunks_exact(size) {
            let values = || samples.iter().filter_map(|&k| x.get(k));
            let centre = mean(values().copied());
            let weight = mean(values().map(|v| (v - centre).powi(2)));
            let middle = 0.5 * (samples.first().copied()? + samples.last().copied()?) as f64;
            if let Some(lag) = lag_of(samples, y, x, fit.lag, range) {
                stretches.push(Stretch { middle, lag, weight });
            }
        }
    }
    let moving = MOVES * mean(stretches.iter().map(|s| s.weight));
    stretches.retain(|s| s.weight >= moving);
    if stretches.len() < FEWEST {
        return None;
    }
    // Stretches have equal weights: the variance of each is itself uncertain.
    let n = stretches.len() as f64;
    let (middle, lag) =
        (mean(stretches.iter().map(|s| s.middle)), mean(stretches.iter().map(|s| s.lag)));
    let spread: f64 = stretches.iter().map(|s| (s.middle - middle).powi(2)).sum();
    let growth =
        stretches.iter().map(|s| (s.middle - middle) * (s.lag - lag)).sum::<f64>() / spread;
    let total: f64 = stretches.iter().map(|s| (s.lag - lag).powi(2)).sum();
    let rest: f64 =
        stretches.iter().map(|s| (s.lag - lag - growth * (s.middle - middle)).powi(2)).sum();
    let variance = rest / (n - 2.0);
    let pure = purity(view, search, output, lag)?;
    let mut timing = Timing {
        lag,
        std: (total / (n - 1.0) / n).sqrt(),
        growth,
        growth_std: (variance / spread).sqrt(),
        straight: 1.0 - rest / total.max(f64::MIN_POSITIVE),
        length: view.records.iter().map(|r| r.time_s.len()).max().unwrap_or(0) as f64,
        pure,
        ahead: 0.0,
    };
    // The fit uses every command at several lags; it runs only for an output that leads.
    if lag < 0.0 && timing.is_late() && !view.predicts() {
        timing.ahead = ahead(view, search, output, lag)?;
    }
    Some(timing).filter(|t| [t.lag, t.std, t.growth, t.growth_std].iter().all(|v| v.is_finite()))
}

/// The misfit reduction by a shift of the model by `lag`, over that by a short two-sided filter. The gain is free in both.
fn purity(view: &View<'_>, search: &Search, output: usize, lag: f64) -> Option<f64> {
    let whole = lag.floor() as isize;
    let shifted = misfit(view, search, output, &[whole, whole + 1], &[])?;
    let none = misfit(view, search, output, &[0], &[])?;
    let both: Vec<isize> = TAPS.iter().copied().chain([whole, whole + 1]).collect();
    let two_sided = misfit(view, search, output, &both, &[])?;
    Some((none - shifted) / (none - two_sided).max(f64::MIN_POSITIVE))
}

/// The reduction by future commands of the misfit that the model's and the commands' present and past leave.
fn ahead(view: &View<'_>, search: &Search, output: usize, lag: f64) -> Option<f64> {
    let back: Vec<isize> = TAPS.iter().copied().filter(|l| *l >= 0).collect();
    let samples: usize = view.records.iter().map(|r| r.time_s.len()).sum();
    if samples < FEWEST_PER_COLUMN * TAPS.len() * (1 + view.system.inputs.len()) {
        return Some(0.0);
    }
    let furthest = lag.floor() as isize;
    let future = [-1, furthest / 2, furthest].into_iter().filter(|l| *l < 0);
    let before = misfit(view, search, output, &back, &back)?;
    let after = misfit(
        view,
        search,
        output,
        &back,
        &back.iter().copied().chain(future).collect::<Vec<_>>(),
    )?;
    Some(1.0 - after / before.max(f64::MIN_POSITIVE))
}

/// The sum of squares that the model's output and all commands at these lags leave of the measured output.
fn misfit(
    view: &View<'_>,
    search: &Search,
    output: usize,
    lags: &[isize],
    command_lags: &[isize],
) -> Option<f64> {
    let sorted = |lags: &[isize]| {
        let mut lags = lags.to_vec();
        lags.sort_unstable();
        lags.dedup();
        lags
    };
    let (lags, command_lags) = (sorted(lags), sorted(command_lags));
    let inputs = view.system.inputs.len();
    let width = lags.len() + inputs * command_lags.len();
    let mut gram = DMatrix::zeros(width, width);
    let mut right: DVector<f64> = DVector::zeros(width);
    let mut power = 0.0;
    // The same samples for every choice of lags.
    let edge = EDGE + view.lags();
    for at in 0..view.records.len() {
        let (y, x) = (&search.measured[at][output], &search.modelled[at][output]);
        let samples: Vec<usize> = view
            .usable(at, output)
            .into_iter()
            .filter(|&k| k >= edge && k + edge < x.len())
            .collect();
        let centre = |v: &[f64]| mean(samples.iter().map(|&k| v[k]));
        let commands: Vec<(&[f64], f64)> =
            view.records[at].inputs.iter().map(|u| (u.as_slice(), centre(u))).collect();
        let signals = || {
            let model = lags.iter().map(|&lag| (x.as_slice(), centre(x), lag));
            model.chain(
                commands
                    .iter()
                    .flat_map(|&(u, centre)| command_lags.iter().map(move |&lag| (u, centre, lag))),
            )
        };
        let columns: Vec<_> = signals().collect();
        let y_mean = centre(y);
        let mut row = vec![0.0; width];
        for &k in &samples {
            for (value, (signal, centre, lag)) in row.iter_mut().zip(&columns) {
                *value = signal.get(k.checked_add_signed(-lag)?)? - centre;
            }
            let y = y[k] - y_mean;
            power += y * y;
            for i in 0..width {
                right[i] += row[i] * y;
                for j in 0..=i {
                    gram[(i, j)] += row[i] * row[j];
                }
            }
        }
    }
    // Columns of equal size; next to equal ones stay solvable.
    let size: Vec<f64> =
        (0..width).map(|i| f64::max(gram[(i, i)], f64::MIN_POSITIVE).sqrt()).collect();
    let scaled = DMatrix::from_fn(width, width, |i, j| {
        gram[(i.max(j), i.min(j))] / (size[i] * size[j]) + if i == j { RIDGE } else { 0.0 }
    });
    let right = DVector::from_fn(width, |i, _| right[i] / size[i]);
    let solution = scaled.cholesky()?.solve(&right);
    Some((power - right.dot(&solution)).max(0.0))
}
