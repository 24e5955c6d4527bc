//! Multiple shooting: a simulator whose free run diverges from the log restarts repeatedly from the logged states, and is judged window by window.
//!
//! A window is as long as possible: its length doubles as long as no perturbation of a state grows more than tenfold within one window.
//!
//! How it can be wrong:
//! * *The logged states are noisy, biased or late.* Each initial state is therefore a nuisance with a prior about the logged value. Its linear response is
//!   integrated out. The prior is as wide as the state moves, unless a standard deviation is given. A narrow prior treats a sensor's bias or delay as certain.
//! * *A window is too short for an effect to be detectable.* The initial states absorb slower effects: drifts, slow lags, small constant forces. No result
//!   reveals such an effect; the windows are therefore the longest possible ones, and their length is reported.
//! * *What came before the window.* Effects act on the commands of the whole log before windows are cut, so a delay's past is the log's. An output's delay or lag
//!   reads the window before, from that window's own start: a step where they meet, as large as the starts disagree.
//! * *Memory that is no state.* The simulator's memory outside the named states (an integrator, a filter) is reset in each window.
//! * *Many starts explain much.* Each takes one degree of freedom; with few samples between two starts they take up the effect itself.

use super::black_box::{GROWS, UNSTABLE, spread};
use super::record::LogRecord;
use crate::error::Result;
use crate::format::diagnosis::STARTED_AGAIN;
use crate::format::error::GapError;
use deadtime_model::simulate::{Commands, Plan, System};

/// Samples of a window at least.
const SHORTEST: usize = 10;
/// Initial states per log at most, of all states together: each is a further column of the log's regression.
const MOST: usize = 800;
/// The perturbation of the initial states, as a part of the state's motion in the log.
const PUSH: f64 = 1e-3;

/// How a simulator is started again.
#[derive(Debug, Clone, Copy)]
struct Restarted {
    /// Seconds between two starts.
    every_s: f64,
    windows: usize,
    /// The growth of a perturbation within one window.
    growth: f64,
}

impl Restarted {
    fn why(self) -> String {
        let Self { every_s, windows, growth } = self;
        match windows {
            1 => "simulated freely, from what the log says of its states at the first sample"
                .to_owned(),
            _ => format!(
                "{STARTED_AGAIN} from what the log says of its states, every {every_s:.3} s ({windows} windows in the longest log); within one a perturbation grows {growth:.1}-fold"
            ),
        }
    }
}

/// Sets the initial states of the simulator on every log, and returns the period in seconds and the reason; `None` where it is started once.
///
/// # Errors
/// [`GapError`]: the simulator fails, a perturbation grows without bounds even in the shortest windows, or the initial states are too many for a fit.
pub(crate) fn restart(system: &System, records: &mut [LogRecord]) -> Result<Option<(f64, String)>> {
    let Some(wanted) = &system.restart else { return Ok(None) };
    let Some(at) = (0..records.len()).max_by_key(|&at| records[at].time_s.len()) else {
        return Ok(None);
    };
    let (samples, sample_time_s) = (records[at].time_s.len(), records[at].sample_time_s);
    let (length, growth) = match wanted.every_s {
        Some(every_s) => {
            let length = (every_s / sample_time_s).round() as usize;
            if length < SHORTEST {
                let (log, least_s) = (records[at].name.clone(), SHORTEST as f64 * sample_time_s);
                return Err(GapError::RestartsTooOften {
                    log,
                    given_s: every_s,
                    got: length,
                    least_s,
                }
                .into());
            }
            (length.min(samples), grown(system, &mut records[at], length)?)
        }
        None => longest(system, &mut records[at])?,
    };
    for record in records.iter_mut() {
        let length = (length as f64 * sample_time_s / record.sample_time_s).round() as usize;
        record.restart_after(length.max(SHORTEST), system);
        if record.start.len() > MOST {
            let (log, every_s) = (record.name.clone(), length as f64 * record.sample_time_s);
            return Err(GapError::TooManyStarts {
                log,
                every_s,
                got: record.start.len(),
                most: MOST,
            }
            .into());
        }
    }
    let restarted = Restarted {
        every_s: length as f64 * sample_time_s,
        windows: samples.div_ceil(length),
        growth,
    };
    Ok(Some((restarted.every_s, restarted.why())))
}

/// The longest windows, in samples, within which no perturbation grows more than tenfold, and the growth there.
fn longest(system: &System, record: &mut LogRecord) -> Result<(usize, f64)> {
    let samples = record.time_s.len();
    let mut length = SHORTEST.min(samples);
    let mut growth = grown(system, record, length)?;
    if growth > UNSTABLE {
        return Err(GapError::Unstable { log: record.name.clone(), factor: growth }.into());
    }
    while length < samples {
        let longer = (2 * length).min(samples);
        // A run that leaves all bounds is too long.
        match grown(system, record, longer) {
            Ok(more) if more <= GROWS => (length, growth) = (longer, more),
            _ => break,
        }
    }
    Ok((length, growth))
}

/// The largest growth of a perturbation of any state from the first third of a window to its last 10 %.
fn grown(system: &System, record: &mut LogRecord, length: usize) -> Result<f64> {
    record.restart_after(length, system);
    let plan = Plan::new(system);
    let (states, samples) = (system.states.len(), record.time_s.len());
    let failed = |e: deadtime_model::simulate::SimulateError| GapError::Nominal {
        log: record.name.clone(),
        why: e.to_string(),
    };
    let commands = Commands { time_s: &record.time_s, inputs: &record.inputs };
    let nominal = system.simulate(&plan, commands, &record.start, None).map_err(failed)?.y;
    let moves: Vec<f64> =
        record.measured.iter().map(|m| spread(&m.values).max(f64::MIN_POSITIVE)).collect();
    let windows = record.start.len() / states.max(1);
    let mut growth: f64 = 1.0;
    for j in 0..states {
        let size = PUSH
            * record.states[j]
                .as_ref()
                .map_or_else(|| system.initial[j].abs().max(0.1), |x| spread(x));
        let mut start = record.start.clone();
        start.iter_mut().skip(j).step_by(states).for_each(|x| *x += size);
        let pushed = system.simulate(&plan, commands, &start, None).map_err(failed)?.y;
        // Per sample of a window, the largest over windows and outputs.
        let mut response = vec![0.0_f64; length];
        for w in 0..windows {
            for (k, row) in (w * samples / windows..(w + 1) * samples / windows).enumerate() {
                let apart = (0..moves.len())
                    .map(|i| (pushed[(row, i)] - nominal[(row, i)]).abs() / moves[i])
                    .fold(0.0, f64::max);
                response[k] = response[k].max(apart);
            }
        }
        let largest = |of: &[f64]| of.iter().copied().fold(0.0, f64::max);
        let used = samples / windows;
        let (early, end) = (
            largest(&response[..(used / 3).max(1)]),
            largest(&response[used - (used / 10).max(1)..used]),
        );
        if early > 0.0 {
            growth = growth.max(end / early);
        }
    }
    Ok(growth)
}
