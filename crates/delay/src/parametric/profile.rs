//! What the losses of an output-error scan say, for every method that reads its delay from one.

use super::evidence::log_evidence;
use crate::error::DelayError;
use crate::estimate::{DelayEstimate, Outcome};
use crate::posterior;
use crate::posterior::Posterior;
use deadtime_identify::{Initial, MAX_OE_ORDER, OeFit, OutputError, Record, largest_pole, power};
use deadtime_signal::fit::Stopped;
use deadtime_signal::stop::Stop;

/// An output-error scan against which nothing speaks.
pub(super) struct Profile<'a> {
    /// The model of every delay.
    pub(super) fits: Vec<Option<OeFit>>,
    /// What their losses say.
    pub(super) posterior: Posterior,
    /// Measured samples for each independent one among the residuals of the best model.
    pub(super) per_independent: f64,
    /// The records as far as they were used.
    pub(super) records: Vec<Record<'a>>,
    /// What a reader must know.
    pub(super) note: Option<String>,
}

/// What makes a delay probable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Weighing {
    /// The loss of its best model.
    Best,
    /// The losses of all models, by how plausible their poles are; of orders without a prior the best one's.
    Average,
}

/// Options out of their range.
pub(super) fn check(
    name: &'static str,
    orders: &OutputError,
    max_samples: usize,
) -> Result<(), DelayError> {
    for (option, value, ok, allowed) in [
        ("nb", orders.nb, orders.nb >= 1, "1 or more"),
        ("nf", orders.nf, orders.nf <= MAX_OE_ORDER, "at most 16"),
        ("max_samples", max_samples, max_samples >= 1, "1 or more"),
    ] {
        if !ok {
            return Err(DelayError::Option { method: name, option, value: value as f64, allowed });
        }
    }
    Ok(())
}

/// The records as far as `max_samples` reach, and the note that says so.
pub(super) fn shortened<'a>(
    records: &'a [Record<'_>],
    max_samples: usize,
) -> (Vec<Record<'a>>, Option<String>) {
    let got = records.iter().map(Record::len).max().unwrap_or(0);
    let note =
        (got > max_samples).then(|| format!("used the first {max_samples} of {got} samples"));
    (records.iter().map(|r| r.head(max_samples)).collect(), note)
}

/// The measured outputs less the residuals.
pub(super) fn model(records: &[Record], residuals: &[f64]) -> Vec<f64> {
    let measured = records.iter().flat_map(|r| {
        (0..r.len()).map(|t| if r.present.as_ref().is_none_or(|p| p[t]) { r.y[t] } else { 0.0 })
    });
    measured.zip(residuals).map(|(y, e)| y - e).collect()
}

/// Noise of which so many samples say no more than one is slow.
const SLOW: f64 = 4.0;

/// The scan of `orders`, or the answer that takes its place: nothing moves, nothing is seen, many delays fit alike, no minimum.
pub(super) fn profile<'a>(
    name: &'static str,
    orders: OutputError,
    max_samples: usize,
    records: &'a [Record<'_>],
    max_delay: usize,
    weighing: Weighing,
    stop: &Stop,
) -> Result<Result<Profile<'a>, DelayEstimate>, DelayError> {
    let parameters = orders.nb + orders.nf;
    let needed = max_delay + orders.nb + 3 * parameters;
    let got = records.iter().map(Record::len).max().unwrap_or(0);
    if got < needed {
        return Err(DelayError::TooShort {
            method: name,
            needed,
            got,
            remedy: crate::error::LengthRemedy::Window,
        });
    }
    let (records, note) = shortened(records, max_samples);
    let fits = orders.scan_until(&records, max_delay, stop);
    let losses: Vec<f64> = fits.iter().map(|f| f.as_ref().map_or(f64::NAN, |f| f.loss)).collect();
    let power = power(&records);
    let floor = posterior::ROUNDING * power;
    let without = |outcome, note: String| Ok(Err(DelayEstimate::without(outcome, note)));
    let smallest = losses.iter().copied().filter(|v| v.is_finite()).min_by(f64::total_cmp);
    let Some(at) = smallest.and_then(|v| losses.iter().position(|&l| l == v)) else {
        return without(
            Outcome::NotRichEnough,
            "the input is zero wherever a model could use it".to_owned(),
        );
    };
    let residuals = fits[at]
        .as_ref()
        .and_then(|fit| orders.residuals(&records, at, &fit.f))
        .unwrap_or_default();
    // Residuals of rounding size are correlated as rounding happens to be, which says nothing of how much the data know.
    let samples = residuals.len() as f64;
    let exact = losses[at] <= floor;
    let independent = if exact { samples } else { posterior::effective_samples(&residuals) };
    let averaged = (weighing == Weighing::Average)
        .then(|| log_evidence(&orders, &records, &fits, floor, samples, independent))
        .flatten();
    let posterior = match averaged {
        Some(logs) => posterior::from_logs(&logs, losses.iter().filter(|&&v| v <= floor).count()),
        None => posterior::posterior(&losses, power, independent),
    };
    let Some(posterior) = posterior else {
        return without(
            Outcome::Singular,
            "no delay has a finite loss: the numbers overflow; scale the channels".to_owned(),
        );
    };
    let best = posterior.best;
    let delays = max_delay + 1;
    let counting = if exact {
        independent
    } else {
        posterior::samples_under(&model(&records, &residuals), &residuals)
    };
    let gain = counting * (power / losses[best].max(f64::MIN_POSITIVE)).ln();
    let free = parameters + if orders.initial == Initial::Estimated { orders.nf } else { 0 };
    // A pole pair may settle on any band: of N/2 narrow ones, of half as many that are twice as wide, and so on, N in all. These are tries too.
    let tried = delays + if orders.nf >= 2 { counting as usize } else { 0 };
    if gain < posterior::visible_gain(free, tried) {
        let note = format!(
            "no model explains the output better than chance (gain {gain:.1}): it does not visibly follow the input"
        );
        return without(Outcome::NotVisible, note);
    }
    // Under noise as slow as this two things that have nothing to do with each other drift alike: the whitened view of an ARX model must see the input too.
    let complete = records.iter().all(|r| r.present.is_none());
    if let Some(note) = (complete && !exact && SLOW * independent < samples)
        .then(|| posterior::unseen(&records, max_delay))
        .flatten()
    {
        return without(Outcome::NotVisible, note);
    }
    // An output-error model that fits exactly does so for as many delays as it has numerator coefficients; more mean that the data do not tell them apart.
    if posterior.is_flat() || posterior.ties > orders.nb {
        let same = posterior.set.max(posterior.ties);
        return without(Outcome::Flat, format!("{same} of {delays} delays fit equally well"));
    }
    // A search that ends at the edge of stability leaves no model; where the data allow another delay that has one, that one is the answer.
    // One that leaves nothing but rounding has nothing left to find.
    let converged = |nk: &usize| {
        fits[*nk].as_ref().is_some_and(|fit| fit.stopped.converged() || fit.loss <= floor)
    };
    let Some(settled) = posterior.order[..posterior.set].iter().copied().find(converged) else {
        let (stopped, pole) = fits[best]
            .as_ref()
            .map_or((Stopped::Undefined, f64::NAN), |fit| (fit.stopped, largest_pole(&fit.f)));
        let note = format!(
            "the optimiser stopped without a minimum ({stopped:?}) at nk = {best}, poles at |z| up to {pole:.4}: an unstable or integrating plant, or feedback"
        );
        return without(Outcome::NotConverged, note);
    };
    let posterior = Posterior { best: settled, ..posterior };
    Ok(Ok(Profile { fits, posterior, per_independent: samples / independent, records, note }))
}
