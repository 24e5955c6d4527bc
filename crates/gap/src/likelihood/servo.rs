//! A servo whose logs the tests of several stages are about.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

use super::active_effects::NO_EFFECT;
use super::gaussian::{Likelihood, Terms};
use super::residuals::residuals;
use crate::baseline::motion::Motion;
use crate::baseline::predictor::Predictor;
use crate::input::inputs::{Inputs, Simulator};
use crate::input::options::GapOptions;
use crate::input::subject::Subject;
use deadtime_log::{Channel, Log};
use deadtime_model::ModelDocument;
use deadtime_model::effect::{Applied, Chance, Scales, find};
use deadtime_model::simulate::{Commands, System};
use deadtime_signal::stop::Stop;

const SERVO: &str = r#"
format = "deadtime/model@1"
name = "servo"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "x" }, { name = "v" }]
outputs = [{ name = "angle" }, { name = "rate" }]
initial = [0.0, 0.0]
initial_std = [0.0, 0.0]
A = [[0.0, 1.0], [-9.0, -2.4]]
B = [[0.0], [9.0]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;

/// The log of a servo with these effects, under commands that change every 5 to 30 samples of 20 ms.
fn log(system: &System, effects: &[Applied], seed: u64) -> Log {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut u: Vec<f64> = Vec::new();
    while u.len() < 900 {
        let level = rng.random_range(-1.0..1.0);
        u.extend(std::iter::repeat_n(level, rng.random_range(5..30)));
    }
    let time_s: Vec<f64> = (0..u.len()).map(|k| 0.02 * k as f64).collect();
    let plan = Applied::plan(system, effects, Chance::Seed(seed)).unwrap();
    let commands = Commands { time_s: &time_s, inputs: std::slice::from_ref(&u) };
    let y = system.simulate(&plan, commands, &[0.0, 0.0], None).unwrap().y;
    let mut channels = vec![Channel::new("u", None, u.clone())];
    for (i, (name, noise)) in [("angle", 0.01), ("rate", 0.02)].into_iter().enumerate() {
        channels.push(Channel::new(
            name,
            None,
            y.column(i).iter().map(|v| v + noise * rng.sample::<f64, _>(StandardNormal)).collect(),
        ));
    }
    Log::new(format!("{seed}.csv"), time_s, channels).unwrap()
}

/// An effect that does nothing.
pub(crate) fn nominal(system: &System, effect: &str, channel: &str) -> Applied {
    Applied::nominal(system, find(effect).unwrap(), channel).unwrap()
}

/// Calls with the likelihood of the servo's model, given two logs of a servo with these effects: their names, channels and values.
pub(crate) fn with_servo(
    truth: &[(&str, &str, &[f64])],
    judge: impl FnOnce(&Likelihood<'_>, &Scales),
) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("servo.toml");
    std::fs::write(&path, SERVO).unwrap();
    let document = ModelDocument::read(&path).unwrap();
    let subject = Subject::from(&document);
    let machine = System::new(&document, |_| Ok(0.0)).unwrap();
    let truth: Vec<Applied> = truth
        .iter()
        .map(|(effect, channel, values)| Applied {
            values: values.to_vec(),
            ..nominal(&machine, effect, channel)
        })
        .collect();
    let logs = [log(&machine, &truth, 1), log(&machine, &truth, 2)];

    let options = GapOptions::default();
    let simulator = Simulator::of(subject, &logs, &Stop::default()).unwrap();
    let inputs = Inputs::new(subject, &simulator, &logs, &[], &options).unwrap();
    let system = &simulator.system;
    let predictor =
        Predictor::of(system, &inputs.training, &inputs.poles, None, None, &options.criteria);
    let motion = Motion::of(system, &[], &inputs.training, &predictor, None).unwrap();
    let noise_std = motion.innovations(&inputs.training, &options.criteria);
    let likelihood = Likelihood::new(Terms {
        system,
        records: &inputs.training,
        predictor: &predictor,
        model_effects: Vec::new(),
        nuisances: &[],
        prior: motion.prior(system),
        noise_std,
        resolution: Vec::new(),
        criteria: options.criteria,
        stop: Stop::default(),
    })
    .unwrap();
    let scales = motion.scales(
        system,
        &inputs.training,
        &residuals(&likelihood, NO_EFFECT).unwrap(),
        inputs.longest_delay_s,
    );
    judge(&likelihood, &scales);
}
