//! Dead times that are taken out of records before a state-space model is identified: shorter pasts, fewer states.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::error::DelayError;
use super::error::Result;
use super::feedback::in_loop;
use super::identifiers::identifier;
use super::job::asked::Job;
use super::job::chosen::chosen;
use super::method::Scope;
use deadtime_identify::subspace::{Identified, IdentifierLine, Recordings};
use deadtime_identify::{IdentifyError, Record};
use deadtime_log::Log;
use deadtime_signal::progress::HowFar;
use deadtime_signal::stop::Stop;

/// Which dead times of the inputs are taken out.
#[derive(Debug, Clone, PartialEq)]
pub enum TakenOut {
    /// Those that estimators find, unless the model behind them is worse.
    Estimated,
    /// None.
    Nothing,
    /// These, of inputs by name, s; of the others none.
    Given(Vec<(String, f64)>),
}

/// A model of what is behind the dead times.
pub struct BehindDelays {
    /// The model.
    pub model: Identified,
    /// What was taken out of each input, samples.
    pub delays: Vec<usize>,
    /// What a reader must know of it, a sentence each.
    pub notes: Vec<String>,
}

/// The part of the work that estimating the delays is.
const DELAYS: f64 = 0.4;
/// What the delays are estimated by: established, fast, and of several classes.
const METHODS: [&str; 3] = ["arxstruc", "oestruc", "threshold"];
/// A delay that misses a whole sample by less than this is that whole sample.
const NEARLY_WHOLE: f64 = 0.1;
/// Lags over which a loop is looked for.
const LOOP: usize = 35;
/// A delay stays unless the model behind it is worse by this much in twice the log-likelihood.
const WORSE: f64 = 6.0;

/// The model by `method` with `options` (a JSON object) of `learnt`, and the delays that were taken out first; `logs` are the records that delays are estimated in.
///
/// # Errors
/// [`deadtime_signal::registry::RegistryError`] for the method and its options, [`DelayError::NoInput`] for a delay of something else, and what identification cannot use.
pub fn identify_behind_delays(
    learnt: &Recordings,
    logs: &[Log],
    method: &str,
    options: &Value,
    taken_out: &TakenOut,
    (stop, far): (&Stop, &HowFar),
) -> Result<BehindDelays> {
    let line = identifier(method)?;
    let whole = line.entry.with(options.clone())?;
    if line.finds_delays {
        if let TakenOut::Given(_) = taken_out {
            return Err(IdentifyError::OwnDelays { method: line.entry.name }.into());
        }
        let mut model = whole.identify(learnt, far)?;
        model.notes.extend(feedback(line, learnt));
        let own = model.parametric.as_ref().map(|p| p.delays.clone());
        let delays = own.unwrap_or_else(|| vec![0; learnt.inputs.len()]);
        return Ok(BehindDelays { model, delays, notes: Vec::new() });
    }
    let none = vec![0; learnt.inputs.len()];
    let (mut delays, mut notes) = match taken_out {
        TakenOut::Estimated => estimated(learnt, logs, (stop, &far.part(0.0, DELAYS)))?,
        TakenOut::Nothing => (none.clone(), Vec::new()),
        TakenOut::Given(given) => whole_samples(learnt, given)?,
    };
    stop.check()?;
    if *taken_out == TakenOut::Estimated && delays != none {
        if worse(learnt, line, options, &delays, far)? {
            notes.push("the estimated delays make the model worse, so none was removed; give them if they are known".to_owned());
            delays = none;
        } else {
            stop.check()?;
        }
    }
    let model = whole.identify(&learnt.behind_delays(&delays)?, &far.part(0.6, 1.0))?;
    Ok(BehindDelays { model, delays, notes })
}

/// The model behind the delays is worse than the one with them.
fn worse(
    learnt: &Recordings,
    line: &IdentifierLine,
    options: &Value,
    delays: &[usize],
    far: &HowFar,
) -> Result<bool> {
    let mut quick = options.clone();
    if let Some(object) = quick.as_object_mut() {
        object.insert("draws".to_owned(), json!(0));
    }
    let quick = line.entry.with(quick)?;
    let longest = delays.iter().max().copied().unwrap_or(0);
    let same_rows =
        learnt.behind_delays(&vec![longest; delays.len()]).and(learnt.behind_delays(delays))?;
    let with = quick.identify(&same_rows, &far.part(DELAYS, 0.5))?;
    let without = quick.identify(learnt, &far.part(0.5, 0.6))?;
    let criterion = |m: &Identified| {
        let parameters = m.order.order * (m.inputs.len() + 2 * m.outputs.len());
        let chosen = m.order.candidates.get(m.order.order - 1);
        let loss = chosen.and_then(|c| c.log_loss).unwrap_or(f64::INFINITY);
        loss * m.rows as f64 + parameters as f64 * (m.rows as f64).ln()
    };
    let scaled = criterion(&without) * with.rows as f64 / without.rows as f64;
    Ok(criterion(&with) > scaled + WORSE)
}

/// What records show of a loop that the method does not bear, for each input and output.
pub(super) fn feedback(line: &IdentifierLine, learnt: &Recordings) -> Vec<String> {
    let mut notes = Vec::new();
    for (j, input) in learnt.inputs.iter().enumerate().filter(|_| line.open_loop) {
        for (i, output) in learnt.outputs.iter().enumerate() {
            let row = |m: &nalgebra::DMatrix<f64>, i: usize| {
                let mean = m.row(i).mean();
                m.row(i).iter().map(|v| v - mean).collect::<Vec<f64>>()
            };
            let records: Vec<Record<'_>> =
                learnt.stretches.iter().map(|s| Record::new(row(&s.u, j), row(&s.y, i))).collect();
            if let Some(found) = in_loop(&records, LOOP, 1).finding() {
                notes.push(format!(
                    "{} depends on {} ({}): a controller; {} is biased then, use pbsidopt",
                    input.name, output.name, found.evidence, line.entry.name
                ));
            }
        }
    }
    notes
}

fn whole_samples(
    learnt: &Recordings,
    given: &[(String, f64)],
) -> Result<(Vec<usize>, Vec<String>)> {
    let (mut delays, mut notes) = (vec![0; learnt.inputs.len()], Vec::new());
    for (name, delay_s) in given {
        let Some((_, delay)) =
            learnt.inputs.iter().zip(&mut delays).find(|(input, _)| input.name == *name)
        else {
            let inputs = learnt.inputs.iter().map(|i| i.name.clone()).collect();
            return Err(DelayError::NoInput { input: name.clone(), inputs }.into());
        };
        let samples = learnt.sample_time.samples(*delay_s)?;
        if samples.fraction != 0.0 {
            let share = samples.fraction;
            notes.push(format!(
                "{name}: {share:.2} of a sample of its delay stays within the model"
            ));
        }
        *delay = samples.whole;
    }
    Ok((delays, notes))
}

/// The shortest delay of each input to any output that is to be believed.
fn estimated(
    learnt: &Recordings,
    logs: &[Log],
    (stop, far): (&Stop, &HowFar),
) -> Result<(Vec<usize>, Vec<String>)> {
    let step_s = learnt.sample_time.seconds();
    let mut notes = Vec::new();
    let methods = chosen(&METHODS.map(str::to_owned), &BTreeMap::new(), &[Scope::Pair])?;
    let names = |named: &[deadtime_identify::subspace::Named]| {
        named.iter().map(|n| n.name.clone()).collect::<Vec<_>>()
    };
    let job = Job {
        name: String::new(),
        methods,
        stop: stop.clone(),
        far: far.clone(),
        ..Job::new(logs.to_vec(), names(&learnt.inputs), names(&learnt.outputs))
    };
    let report = job.run()?;
    let delay = |input: &str| {
        let of_input = report.pairs.iter().filter(|p| p.input == input);
        let believed = of_input.filter_map(|p| {
            let delay_s = p.verdict.delay_s?;
            // Where the interval is wider than two samples, its lower end: too long a delay harms, too short a one costs a state.
            let unsure = p.verdict.ci95_s.filter(|ci| ci[1] - ci[0] > 2.0 * step_s);
            Some(unsure.map_or(delay_s, |ci| ci[0].min(delay_s)))
        });
        believed.reduce(f64::min).map(|s| (s.max(0.0) / step_s + NEARLY_WHOLE).floor() as usize)
    };
    let each = learnt.inputs.iter().map(|input| match delay(&input.name) {
        Some(samples) => samples,
        None => {
            notes.push(format!("{}: its dead time is not known beforehand, so none is removed; give it if it is known", input.name));
            0
        }
    });
    let delays = each.collect();
    Ok((delays, notes))
}
