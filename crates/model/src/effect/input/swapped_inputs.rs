//! Two commands are swapped in their paths: the wiring, or the order of two columns.
//!
//! Equation: v_a = (1 − share)·u_a + share·u_b and v_b = (1 − share)·u_b + share·u_a; a share of 1 swaps them.

use crate::effect::channel;
use crate::effect::definition::{Effect, Facts, OnChannel, Site};
use crate::effect::error::Result;
use crate::effect::parameter::Parameter;
use crate::effect::scales::Scales;
use crate::simulate::plan::Plan;
use crate::simulate::system::System;

/// Two commands are swapped.
///
/// Assumes: both have one unit. The other effects on their paths act before the swap.
/// Fails when: both commands are equal, or have equal effects on the outputs.
/// Source: Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd edition (axes and their alignment).
#[derive(Debug, Clone, Copy)]
pub(crate) struct SwappedInputs;

impl Effect for SwappedInputs {
    fn facts(&self) -> Facts {
        Facts {
            rule: "`a<->b`: two inputs of equal unit",
            ..Facts::of("swapped_inputs", Site::Input, "two commands are swapped")
        }
    }

    fn channels(&self, system: &System) -> Vec<String> {
        channel::alike(&system.inputs)
    }

    fn parameters(&self, on: OnChannel<'_>) -> Result<Vec<Parameter>> {
        on.swap(&on.system.inputs)?;
        Ok(vec![channel::share()])
    }

    fn starts(&self, _: OnChannel<'_>, _: &Scales) -> Vec<Vec<f64>> {
        vec![vec![1.0]]
    }

    fn apply(&self, on: OnChannel<'_>, values: &[f64], plan: &mut Plan) -> Result<()> {
        let (a, b) = on.swap(&on.system.inputs)?;
        plan.swaps.push((a, b, values[0]));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::applied::{Applied, Chance};
    use crate::effect::effects::find;
    use crate::file::document::ModelDocument;
    use crate::simulate::run::Commands;
    use crate::simulate::system::System;

    const CONTINUOUS: &str = r#"
format = "deadtime/model@1"
name = "two"
kind = "lti"
inputs = [{ name = "u" }, { name = "v" }]
states = [{ name = "p" }, { name = "q" }]
outputs = [{ name = "y" }, { name = "z" }]
A = [[-3.0, 0.2], [0.0, -0.7]]
B = [[3.0, 0.5], [0.0, 0.7]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0, 0.1], [0.0, 0.0]]
"#;

    /// Whole swaps equal swapped columns of a log, for either kind of model.
    #[test]
    fn swapped_channels_are_swapped_columns() {
        let sampled = CONTINUOUS.replace(
            "A = [[-3.0, 0.2], [0.0, -0.7]]",
            "sample_time_s = 0.1\nA = [[0.7, 0.1], [0.0, 0.9]]",
        );
        for text in [CONTINUOUS, &sampled] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("model.toml");
            std::fs::write(&path, text).unwrap();
            let system = System::new(&ModelDocument::read(&path).unwrap(), |_| Ok(0.0)).unwrap();
            let time_s: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
            let u: Vec<f64> = (0..40).map(|k| f64::from(k % 7) - 3.0).collect();
            let v: Vec<f64> = (0..40).map(|k| f64::from(k % 5) - 1.0).collect();
            let run = |effect: Option<(&str, &str)>, inputs: &[Vec<f64>]| {
                let effects: Vec<Applied> = effect
                    .map(|(name, channel)| {
                        let nominal =
                            Applied::nominal(&system, find(name).unwrap(), channel).unwrap();
                        Applied { values: vec![1.0], ..nominal }
                    })
                    .into_iter()
                    .collect();
                let plan = Applied::plan(&system, &effects, Chance::Mean).unwrap();
                let commands = Commands { time_s: &time_s, inputs };
                system.simulate(&plan, commands, &[0.3, -0.2], None).unwrap().y
            };
            let plain = run(None, &[u.clone(), v.clone()]);
            let inputs = run(Some(("swapped_inputs", "u<->v")), &[v.clone(), u.clone()]);
            let outputs = run(Some(("swapped_outputs", "y<->z")), &[u, v]);
            assert!((&inputs - &plain).amax() < 1e-12);
            assert!((outputs.column(0) - plain.column(1)).amax() < 1e-12);
            assert!((outputs.column(1) - plain.column(0)).amax() < 1e-12);
            assert!((outputs - plain).amax() > 0.1);
        }
    }
}
