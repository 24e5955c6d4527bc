//! What a diagnosis of a linear model costs, estimated before the search begins.
//!
//! How it can be wrong: the estimate counts operations of one thread at a rate that was measured once, and a search that stops early or composes many causes takes
//! 30 % or 300 % of it. It refuses what is out of reach, and promises nothing.

use super::record::LogRecord;
use crate::format::error::GapError;
use deadtime_model::simulate::{Dynamics, System};

/// Operations of a matrix exponential of n states, over n³: scaling and squaring of order 13 (Higham 2005, doi:10.1137/04061101X), eight squarings.
const EXPONENTIAL: f64 = 28.0;
/// Operations a second of one core.
const RATE: f64 = 1.0e9;
/// Simulations for one candidate over a whole search, at that rate: processor time of diagnoses of drawn models with 12 states and 1 input, 12 and 4, 20 and 10
/// (1.8, 3.3 and 31 s), over the operations of one simulation and the candidates (17, 19 and 18).
const SIMULATIONS: f64 = 18.0;

/// The time of a diagnosis on one core, s; 0 where it cannot be estimated (equations and programs).
pub(crate) fn estimated_s(system: &System, records: &[LogRecord], candidates: usize) -> f64 {
    let Dynamics::Linear(matrices) = &system.dynamics else { return 0.0 };
    let n = matrices.a.nrows() as f64;
    let ports = (system.inputs.len() + system.outputs.len()) as f64;
    let rows = rows(records) as f64;
    let one = EXPONENTIAL * n.powi(3) + 2.0 * rows * (n * n + n * ports);
    candidates as f64 * SIMULATIONS * one / RATE
}

fn rows(records: &[LogRecord]) -> usize {
    records.iter().map(|r| r.time_s.len()).sum()
}

/// Refuses a diagnosis whose estimate exceeds the longest time that it may take.
///
/// # Errors
/// [`GapError::TooWide`] with the estimate.
pub(crate) fn must_end_in_time(
    system: &System,
    records: &[LogRecord],
    candidates: usize,
    longest_s: f64,
) -> Result<(), GapError> {
    let seconds = estimated_s(system, records, candidates);
    if seconds <= longest_s {
        return Ok(());
    }
    Err(GapError::TooWide {
        model: system.name.clone(),
        states: system.states.len(),
        inputs: system.inputs.len(),
        candidates,
        rows: rows(records),
        minutes: seconds / 60.0,
        most: longest_s / 60.0,
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

    #[test]
    fn the_estimate_grows_with_states_inputs_and_candidates_and_refuses_only_what_is_out_of_reach()
    {
        let estimate =
            |states, inputs, candidates| estimated_s(&wide(states, inputs), &[], candidates);
        assert!(estimate(12, 1, 400) < 60.0);
        assert!(estimate(100, 1, 400) > 5.0 * estimate(50, 1, 400));
        assert!(estimate(300, 1, 1000) > 3600.0);
        let refused = must_end_in_time(&wide(300, 1), &[], 1000, 600.0).unwrap_err().to_string();
        for part in [
            "wide: 1000 candidate effects on 300 states and 1 inputs",
            "minutes on one core",
            "`effects`",
        ] {
            assert!(refused.contains(part), "{refused}");
        }
        assert!(must_end_in_time(&wide(300, 1), &[], 1000, f64::INFINITY).is_ok());
        assert!(must_end_in_time(&wide(12, 4), &[], 600, 600.0).is_ok());
    }
}
