//! The cost of a diagnosis of a linear model, estimated before the search begins.
//!
//! How it can be wrong: the estimate counts operations of one thread at a constant rate. A search that stops early or combines many causes takes
//! 30 % or 300 % of it. The estimate only rejects infeasible diagnoses.

use super::options::GapOptions;
use crate::format::error::GapError;
use deadtime_model::effect::{EFFECTS, Effect};
use deadtime_model::simulate::{Dynamics, System};

/// Operations of a matrix exponential of n states, over n³: scaling and squaring of order 13 (Higham 2005, doi:10.1137/04061101X), eight squarings.
const EXPONENTIAL: f64 = 28.0;
/// Operations a second of one core.
const RATE: f64 = 1.0e9;
/// Simulations for one candidate over a whole search, at that rate. The value is the processor time of diagnoses over the operations of one simulation and the
/// candidates (17, 19 and 18). The drawn models have 12 states and 1 input, 12 and 4, 20 and 10 (1.8, 3.3 and 31 s).
const SIMULATIONS: f64 = 18.0;

/// Candidates of the catalogue, before it is known which of them are visible.
fn candidates(system: &System, effects: &[String]) -> usize {
    let wanted = |e: &&&dyn Effect| effects.is_empty() || effects.iter().any(|n| n == e.name());
    EFFECTS.iter().filter(wanted).map(|effect| effect.channels(system).len()).sum()
}

/// The time of a diagnosis on one core, s; 0 where it cannot be estimated (equations and programs).
fn estimated_s(system: &System, rows: usize, candidates: usize) -> f64 {
    let Dynamics::Linear(matrices) = &system.dynamics else { return 0.0 };
    let n = matrices.a.nrows() as f64;
    let ports = (system.inputs.len() + system.outputs.len()) as f64;
    let one = EXPONENTIAL * n.powi(3) + 2.0 * rows as f64 * (n * n + n * ports);
    candidates as f64 * SIMULATIONS * one / RATE
}

/// Refuses a diagnosis of so many rows whose estimate exceeds the longest time that it may take.
///
/// # Errors
/// [`GapError::TooWide`] with the estimate.
pub(crate) fn must_end_in_time(
    system: &System,
    rows: usize,
    options: &GapOptions,
) -> Result<(), GapError> {
    let candidates = candidates(system, &options.effects);
    let seconds = estimated_s(system, rows, candidates);
    if seconds <= options.longest_run_s {
        return Ok(());
    }
    Err(GapError::TooWide {
        model: system.name.clone(),
        states: system.states.len(),
        inputs: system.inputs.len(),
        candidates,
        rows,
        minutes: seconds / 60.0,
        most: options.longest_run_s / 60.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_model::ModelDocument;
    use deadtime_model::simulate::System;

    /// A diagonal model of so many states and inputs.
    fn wide(states: usize, inputs: usize) -> System {
        let list = |name: &str, count: usize| {
            (0..count).map(|i| format!("{{ name = \"{name}{i}\" }}")).collect::<Vec<_>>().join(", ")
        };
        let matrix = |rows: usize, columns: usize, of: &dyn Fn(usize, usize) -> f64| {
            let row =
                |i| (0..columns).map(|j| format!("{:?}", of(i, j))).collect::<Vec<_>>().join(", ");
            (0..rows).map(|i| format!("[{}]", row(i))).collect::<Vec<_>>().join(", ")
        };
        let text = format!(
            "format = \"deadtime/model@1\"\nname = \"wide\"\nkind = \"lti\"\ninputs = [{}]\nstates = [{}]\noutputs = [{}]\nA = [{}]\nB = [{}]\nC = [{}]\nD = [{}]\n",
            list("u", inputs),
            list("x", states),
            list("y", 1),
            matrix(states, states, &|i, j| if i == j { -1.0 - i as f64 } else { 0.0 }),
            matrix(states, inputs, &|_, _| 1.0),
            matrix(1, states, &|_, _| 1.0),
            matrix(1, inputs, &|_, _| 0.0),
        );
        let file = ModelDocument::from_toml(&text, std::path::Path::new("wide.toml")).unwrap();
        System::new(&file, |_| Ok(0.0)).unwrap()
    }

    fn refused(
        states: usize,
        inputs: usize,
        effects: &[&str],
        longest_run_s: f64,
    ) -> Option<String> {
        let effects = effects.iter().map(|e| (*e).to_owned()).collect();
        let options = GapOptions { effects, longest_run_s, ..GapOptions::default() };
        must_end_in_time(&wide(states, inputs), 600, &options).err().map(|e| e.to_string())
    }

    #[test]
    fn what_is_out_of_reach_is_refused_with_the_estimate_and_named_effects_narrow_it() {
        for (states, inputs) in [(300, 1), (100, 10)] {
            let why = refused(states, inputs, &[], 600.0).unwrap();
            let said =
                format!("candidate effects on {states} states and {inputs} inputs over 600 rows");
            assert!(why.contains(&said) && why.contains("on one core, more than 10"), "{why}");
            assert!(why.contains("`effects`"), "{why}");
            assert_eq!(refused(states, inputs, &["input_delay", "actuator_lag"], 600.0), None);
            assert_eq!(refused(states, inputs, &[], f64::INFINITY), None);
        }
        for (states, inputs) in [(4, 1), (12, 4), (20, 4)] {
            assert_eq!(refused(states, inputs, &[], 600.0), None, "{states} {inputs}");
        }
    }

    #[test]
    fn the_estimate_grows_with_states_inputs_and_rows() {
        let of = |states, inputs, rows| estimated_s(&wide(states, inputs), rows, 400);
        assert!(of(100, 1, 600) > 5.0 * of(50, 1, 600));
        assert!(of(10, 100, 600) > 5.0 * of(10, 1, 600));
        assert!(of(10, 1, 60_000) > 50.0 * of(10, 1, 600));
    }
}
