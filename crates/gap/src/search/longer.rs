//! Whether the search needs longer delays: from shifts of the model's own prediction before a search, and from a delay at the limit after one.
//!
//! How it can be wrong: slow motions of a few oscillations correlate at many shifts, and a wrong model correlates at none. A shift beyond the limit must
//! therefore leave much less of the motion than every shift within, and little of it. A periodic command correlates again after one period, but never better.
//! With a range that is too long, a longer part of each log's start carries no weight, and the search takes longer. In long logs the shifts are coarse: fast
//! motions correlate at none of them. Only a delay at the search's limit then reveals a longer one.

use nalgebra::DMatrix;

use super::catalogue_search::SearchResult;
use crate::hypothesis::effects::Hypothesis;
use crate::hypothesis::level::Level;
use crate::input::criteria::Criteria;
use crate::input::record::LogRecord;
use crate::likelihood::gaussian::Likelihood;
use deadtime_model::effect::{Role, Scales};
use deadtime_signal::parallel;

/// Shifts of either sign that are tried, and rows of one log that are compared; more are thinned.
const SHIFTS: usize = 300;
const ROWS: usize = 4000;

/// The shift of the model's prediction, later or earlier, with the best correlation to the measurement, seconds. `None` where no shift beyond the longest delay
/// is much better than all within. `residuals`: of the nominal model, run freely.
pub(crate) fn shift_beyond(
    records: &[LogRecord],
    residuals: &[DMatrix<f64>],
    longest_s: f64,
    limit_s: f64,
    criteria: &Criteria,
) -> Option<f64> {
    let outputs = residuals.first().map_or(0, DMatrix::ncols);
    let sample_time_s = records.iter().map(|r| r.sample_time_s).fold(f64::INFINITY, f64::min);
    let step_s = sample_time_s.max(limit_s / SHIFTS as f64);
    let most = (limit_s / step_s).floor() as i32;
    let tried: Vec<(f64, Vec<f64>)> = parallel::map(-most..=most, |i| {
        let shift_s = f64::from(i) * step_s;
        let of = |output| unlike(records, residuals, output, shift_s);
        (shift_s, (0..outputs).map(of).collect())
    });
    let beyond = |left: &dyn Fn(&[f64]) -> f64| {
        let least = |further: bool| {
            let those = tried.iter().filter(|(shift_s, _)| (shift_s.abs() > longest_s) == further);
            those
                .map(|(shift_s, unlike)| (left(unlike), shift_s.abs()))
                .min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let ((within, _), (further, shift_s)) = (least(false)?, least(true)?);
        (further < (1.0 - criteria.much) * within && further < 1.0 - criteria.moved_explains)
            .then_some(shift_s)
    };
    // A clock moves all outputs, a sensor one.
    let all = beyond(&|unlike| unlike.iter().sum::<f64>() / outputs as f64);
    (0..outputs)
        .filter_map(|output| beyond(&|unlike| unlike[output]))
        .chain(all)
        .max_by(f64::total_cmp)
}

/// The part of one output's variance over the training samples that the shifted prediction leaves, with a free gain and constant. It is one less the squared
/// correlation; 1 where the gain would be negative.
fn unlike(records: &[LogRecord], residuals: &[DMatrix<f64>], output: usize, shift_s: f64) -> f64 {
    let (mut count, mut sums, mut squares) = (0.0, [0.0; 2], [0.0; 3]);
    // Large constants would drown small motions.
    let origin =
        records.first().and_then(|r| r.measured[output].values.first()).copied().unwrap_or(0.0);
    for (record, residual) in records.iter().zip(residuals) {
        let Some(span) = record.train else { continue };
        let measured = &record.measured[output];
        let shift = (shift_s / record.sample_time_s).round() as isize;
        let inside = |k: usize| {
            record.time_s.get(k).is_some_and(|t| span.holds(*t)) && measured.get(k).is_some()
        };
        for k in (0..record.time_s.len()).step_by(record.time_s.len().div_ceil(ROWS).max(1)) {
            let Some(before) =
                k.checked_add_signed(-shift).filter(|&before| inside(k) && inside(before))
            else {
                continue;
            };
            let (y, predicted) = (
                measured.values[k] - origin,
                measured.values[before] - origin - residual[(before, output)],
            );
            count += 1.0;
            sums = [sums[0] + y, sums[1] + predicted];
            squares = [
                squares[0] + y * y,
                squares[1] + y * predicted,
                squares[2] + predicted * predicted,
            ];
        }
    }
    let [yy, yp, pp] =
        [(0, 0), (0, 1), (1, 1)].map(|(i, j)| sums[i] * sums[j] / f64::max(count, 1.0));
    let (yy, yp, pp) = (squares[0] - yy, squares[1] - yp, squares[2] - pp);
    if yp > 0.0 && yy > 0.0 && pp > 0.0 { (1.0 - yp * yp / (yy * pp)).max(0.0) } else { 1.0 }
}

impl SearchResult {
    /// Whether a delay that explains much of the gap is at the limit of the search. Under noise of the gap's colour half a delay gains little, also where it
    /// reduces the error by much.
    pub(crate) fn wants_longer_delays(
        &self,
        likelihood: &Likelihood<'_>,
        scales: &Scales,
        criteria: &Criteria,
    ) -> bool {
        // A latent sequence gains much by its freedom.
        let best = self
            .singles
            .iter()
            .filter(|e| e.fitted && e.lost.is_none())
            .map(|e| e.gain)
            .fold(0.0, f64::max);
        let at_edge = |e: &Hypothesis| {
            e.free.iter().any(|&(at, i)| {
                let p = &e.effects[at].parameters[i];
                matches!(p.role, Role::Delay | Role::Period | Role::Clock)
                    && e.effects[at].values[i] != p.nominal
                    && e.at_bound((at, i), scales)
            })
        };
        let nothing = Level::of(likelihood, None);
        let takes = |e: &Hypothesis| {
            Some(1.0 - Level::of(likelihood, Some(e))?.train.over(&nothing.as_ref()?.train))
        };
        let much = |e: &Hypothesis| {
            e.gain > criteria.much * best || takes(e).is_some_and(|share| share > criteria.much)
        };
        self.singles
            .iter()
            .any(|e| e.fitted && e.gain > criteria.selection_penalty && at_edge(e) && much(e))
    }
}
