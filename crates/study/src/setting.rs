//! One combination of a plan's lists, and the records that it makes.

use std::path::Path;

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use sha2::{Digest, Sha256};

use super::bound::bound_samples;
use super::error::{Result, StudyError};
use super::feedback;
use super::keys::{Delay, Drawn, Loop, Place};
use super::logging::{Logging, STEPS, held};
use super::passages::{EVENTS, passages};
use super::plan::{Colour, Controller, Draw, Grid, PLAIN, Plan, Scoring, Signal};
use super::plants::{PLANTS, Plant, PlantEntry};
use deadtime_delay::{Detrend, Experiment, PlantModel, Recording};
use deadtime_model::c2d::{CONVERSIONS, Conversion, Tustin};
use deadtime_model::simulate::{Options, Prehistory, lsim};
use deadtime_model::{ModelFile, Sampled, StateSpace, dlqr};
use deadtime_signal::file::read_text;
use deadtime_signal::registry::{self, Entry};
use deadtime_signal::time::SampleTime;
use deadtime_signal::{
    EXCITATIONS, Excitation, Noise, NoiseColour, NoiseScaling, stats, unit_noise,
};

/// The content of a record: the keys of a cell that it shares with every method, place, input and output.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// The plant.
    pub plant: String,
    /// The conversion to sampled time.
    pub c2d: String,
    /// The excitation.
    pub excitation: String,
    /// var(noise-free output)/var(noise).
    pub snr: f64,
    /// The noise.
    pub noise: String,
    /// The loop.
    pub loops: Loop,
    /// The controller of a closed loop.
    pub controller: Option<String>,
    /// The injected delay.
    pub delay: Delay,
    /// Samples.
    pub samples: usize,
    /// The sample time, s.
    pub sample_time_s: f64,
    /// How it was logged.
    pub logging: String,
}

impl std::fmt::Display for Key {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            plant, c2d, excitation, snr, noise, delay, samples, sample_time_s, logging, ..
        } = self;
        write!(f, "{plant} {c2d} {excitation} snr {snr} {noise} {:?} ", self.loops)?;
        write!(
            f,
            "{} delay {delay} s, {samples} samples of {sample_time_s} s",
            self.controller.as_deref().unwrap_or("no controller")
        )?;
        // A record that lacks nothing has the seed that it had before there were others.
        if logging == PLAIN { Ok(()) } else { write!(f, ", {logging}") }
    }
}

/// A plant of the list, or a model file's.
enum PlantSource {
    Listed(&'static PlantEntry),
    File(Box<Plant>),
}

/// A key with everything it names.
pub(super) struct Setting {
    pub(super) key: Key,
    pub(super) grid: usize,
    pub(super) max_delay: usize,
    pub(super) trials: usize,
    pub(super) inputs: Vec<String>,
    pub(super) outputs: Vec<String>,
    pub(super) sample_time: SampleTime,
    source: PlantSource,
    conversion: Box<dyn Conversion>,
    /// `None`: events.
    excitation: Option<Box<dyn Excitation>>,
    draw: Draw,
    logging: Logging,
    colour: Colour,
    controller: Option<Controller>,
    pub(super) detrend: Detrend,
    known_degree: bool,
    /// The states are measured too, for methods that use them.
    states: bool,
    /// Digest of the definitions of the names of the key, and of the scoring.
    pub(super) definition: String,
    /// Every record is the same: no noise, and nothing drawn.
    pub(super) repeatable: bool,
}

/// The noise-free signals of a plant, and the model that methods receive.
struct Clean {
    input: Vec<Vec<f64>>,
    outputs: Vec<Vec<f64>>,
    states: Vec<Vec<f64>>,
    model: PlantModel,
}

/// The measurement of a trial, and its known truth.
pub(super) struct Record {
    pub(super) seed: u64,
    /// From the plant's input; from the reference. `None` too where nothing could be made of it.
    pub(super) from: [Option<Experiment<'static>>; 2],
    /// Injected, s, by input.
    pub(super) delay_s: Vec<f64>,
    /// Samples of response, by output and input.
    pub(super) degree: Vec<Vec<usize>>,
    /// The least standard deviation of an unbiased estimate from the plant's input, samples, by output; where it is known.
    pub(super) bound_samples: Vec<Option<f64>>,
}

impl Record {
    pub(super) fn experiment(&self, place: Place) -> Option<&Experiment<'static>> {
        match place {
            Place::U => self.from[0].as_ref(),
            Place::R => self.from[1].as_ref(),
        }
    }
}

/// `NAME KEY=VALUE …` as an entry of a registry with options.
pub(super) fn named<T: ?Sized>(
    entries: &'static [Entry<T>],
    kind: &'static str,
    text: &str,
) -> Result<(&'static Entry<T>, serde_json::Value)> {
    let mut words = text.split_whitespace();
    let entry = registry::find(entries, kind, words.next().unwrap_or_default())?;
    Ok((entry, registry::options(words)?))
}

/// The message on a name outside a plan.
fn unknown<'k>(what: &str, name: &str, known: impl Iterator<Item = &'k str>) -> String {
    format!("there is no {what} `{name}`; there are: {}", known.collect::<Vec<_>>().join(", "))
}

/// A plan's error.
type Wrong<'w> = &'w dyn Fn(String) -> StudyError;

/// The conversion that a key names; one that rounds delays takes whole ones only.
fn conversion(key: &Key, sample_time: SampleTime, wrong: Wrong<'_>) -> Result<Box<dyn Conversion>> {
    let (entry, options) = named(CONVERSIONS, "conversion", &key.c2d)?;
    let conversion = entry.with(options.clone())?;
    // These two conversions round a delay to the nearest sample by default: the simulated delay would differ from the specified one.
    let rounds = match entry.name {
        "tustin" => {
            serde_json::from_value::<Tustin>(options).is_ok_and(|t| t.fractional_delay_order == 0)
        }
        "matched" => true,
        _ => false,
    };
    let delays = match &key.delay {
        Delay::Same(s) => std::slice::from_ref(s),
        Delay::PerInput(all) => all,
        Delay::Drawn(_) => &[],
    };
    let delays = delays.iter().map(|s| sample_time.samples(*s)).collect::<Result<Vec<_>, _>>()?;
    let fractional = matches!(&key.delay, Delay::Drawn(drawn) if !drawn.whole)
        || delays.iter().any(|d| d.fraction != 0.0);
    if rounds && fractional {
        let detail = format!(
            "`{}` puts a delay on the nearest sample: inject whole samples, or give tustin fractional_delay_order=3",
            key.c2d
        );
        return Err(wrong(detail).into());
    }
    Ok(conversion)
}

/// The noise that a key names.
fn colour(plan: &Plan, key: &Key, wrong: Wrong<'_>) -> Result<Colour> {
    let colour = match (key.noise.as_str(), plan.noises.get(&key.noise)) {
        ("white", _) => Colour::default(),
        (_, Some(colour)) => colour.clone(),
        (name, None) => {
            let known = plan.noises.keys().map(String::as_str).chain(["white"]);
            return Err(wrong(unknown("noise", name, known)).into());
        }
    };
    if colour.innovation_std.is_some() && key.snr.is_finite() {
        return Err(wrong(format!(
            "noise `{}` has a level of its own (innovation_std): leave out `snr`",
            key.noise
        ))
        .into());
    }
    Ok(colour)
}

/// The controller that a key names; `None`: none, or one that feeds back the states.
fn controller(
    plan: &Plan,
    key: &Key,
    channels: (usize, usize),
    wrong: Wrong<'_>,
) -> Result<Option<Controller>> {
    let controller = match key.controller.as_deref() {
        None | Some("dlqr") => None,
        Some(name) => match plan.controllers.get(name) {
            Some(controller) => Some(controller.clone()),
            None => {
                let known = plan.controllers.keys().map(String::as_str).chain(["dlqr"]);
                return Err(wrong(unknown("controller", name, known)).into());
            }
        },
    };
    if controller.is_some() && channels != (1, 1) {
        return Err(wrong(format!(
            "controller `{}` has one input and one output, {} has more",
            key.controller.as_deref().unwrap_or(""),
            key.plant
        ))
        .into());
    }
    Ok(controller)
}

/// The way of logging that a key names, for a plant of so many states measured.
fn logging(
    plan: &Plan,
    key: &Key,
    source: &PlantSource,
    states: bool,
    wrong: Wrong<'_>,
) -> Result<Logging> {
    let logging = match (key.logging.as_str(), plan.loggings.get(&key.logging)) {
        (PLAIN, _) => Logging::default(),
        (_, Some(logging)) => *logging,
        (name, None) => {
            let known = plan.loggings.keys().map(String::as_str).chain([PLAIN]);
            return Err(wrong(unknown("logging", name, known)).into());
        }
    };
    let sampled =
        matches!(source, PlantSource::File(plant) if matches!(plant.model, PlantModel::Sampled(_)));
    if logging.jitter > 0.0 && (states || sampled || key.c2d != "zoh" || key.loops != Loop::Open) {
        let detail = format!(
            "logging `{}`: uneven stamps are simulated between the samples of continuous plants behind `zoh` in an open loop, for methods that look at pairs",
            key.logging
        );
        return Err(wrong(detail).into());
    }
    Ok(logging)
}

/// Events pass through a dead time and nothing else.
fn only_events(key: &Key, logging: &Logging, wrong: Wrong<'_>) -> Result<()> {
    let plain = key.plant == "gain"
        && key.c2d == "zoh"
        && key.noise == "white"
        && key.loops == Loop::Open
        && logging.jitter == 0.0;
    if plain {
        return Ok(());
    }
    let detail = format!(
        "excitation `{EVENTS}`: events pass from place to place through plant `gain`, in an open loop, with `zoh`, white errors of their times and stamps without jitter; this is {key}"
    );
    Err(wrong(detail).into())
}

/// The excitation that a key names; `None`: events.
fn excitation(
    key: &Key,
    signal: Signal,
    logging: &Logging,
    wrong: Wrong<'_>,
) -> Result<Option<Box<dyn Excitation>>> {
    if key.excitation == EVENTS {
        return only_events(key, logging, wrong).map(|()| None);
    }
    let (entry, more) = named(EXCITATIONS, "excitation", &signal.signal)?;
    let mut options = signal.options;
    options.extend(more.as_object().cloned().unwrap_or_default());
    Ok(Some(entry.with(serde_json::Value::Object(options))?))
}

impl Setting {
    /// Finds the entries that a key names.
    pub(super) fn new(
        plan: &Plan,
        number: usize,
        key: Key,
        max_delay: usize,
        states: bool,
    ) -> Result<Self> {
        let grid: &Grid = &plan.grids[number];
        let wrong: Wrong<'_> = &|detail| StudyError::Plan { plan: plan.name.clone(), detail };
        let (source, inputs, outputs) = source(&key.plant, &plan.folder)?;
        let sample_time = SampleTime::new(key.sample_time_s)?;
        let conversion = conversion(&key, sample_time, wrong)?;
        if let Delay::PerInput(all) = &key.delay
            && all.len() != inputs.len()
        {
            return Err(wrong(format!(
                "delay_s holds {} delays for the {} inputs of {}",
                all.len(),
                inputs.len(),
                key.plant
            ))
            .into());
        }
        let signal = plan.excitations.get(&key.excitation).cloned().unwrap_or_else(|| Signal {
            signal: key.excitation.clone(),
            options: serde_json::Map::new(),
            draw: Draw::EachTrial,
        });
        let definition = definition(plan, grid, &key, &signal)?;
        let logging = logging(plan, &key, &source, states, wrong)?;
        let draw = signal.draw;
        let excitation = excitation(&key, signal, &logging, wrong)?;
        let colour = colour(plan, &key, wrong)?;
        let controller = controller(plan, &key, (inputs.len(), outputs.len()), wrong)?;
        let mut setting = Self {
            grid: number,
            max_delay,
            trials: grid.trials,
            inputs,
            outputs,
            sample_time,
            source,
            conversion,
            excitation,
            draw,
            logging,
            colour,
            controller,
            detrend: grid.detrend,
            known_degree: grid.known_degree,
            states,
            definition,
            repeatable: false,
            key,
        };
        setting.repeatable = setting.is_repeatable()?;
        Ok(setting)
    }

    fn is_repeatable(&self) -> Result<bool> {
        let fixed = match &self.source {
            PlantSource::Listed(entry) => !entry.random,
            PlantSource::File(_) => true,
        };
        let quiet =
            self.key.snr.is_infinite() && self.colour.innovation_std.is_none_or(|std| std == 0.0);
        let chosen = !matches!(self.key.delay, Delay::Drawn(_));
        let drive = |seed| self.drive(&mut ChaCha8Rng::seed_from_u64(seed));
        Ok(self.excitation.is_some()
            && self.logging.is_plain()
            && fixed
            && quiet
            && chosen
            && drive(0)? == drive(1)?)
    }

    /// The seed of a record: a hash of the plan's seed, the content of the record and its number. No other record of a plan changes it.
    pub(super) fn seed(&self, seed: u64, trial: usize) -> u64 {
        hash(&format!("{seed}|{}|{trial}", self.key))
    }

    /// Record `trial`.
    pub(super) fn record(&self, plan_seed: u64, trial: usize) -> Result<Record> {
        let seed = self.seed(plan_seed, trial);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let delay_s = self.delays(&mut rng);
        if self.excitation.is_none() {
            return self.passages(seed, delay_s, &mut rng);
        }
        let plant = match &self.source {
            PlantSource::Listed(entry) => entry.build(&mut rng)?,
            PlantSource::File(plant) => (**plant).clone(),
        };
        let drive = match self.draw {
            Draw::EachTrial => self.drive(&mut rng)?,
            Draw::Once => self.drive(&mut ChaCha8Rng::seed_from_u64(hash(&format!(
                "{plan_seed}|{}|{}",
                self.key.excitation, self.key.samples
            ))))?,
        };
        let bare = self.sampled(&plant.model, &vec![0.0; delay_s.len()])?;
        let stamps = self.logging.stamps(self.key.samples, &mut rng);
        let Clean { input, outputs: clean, states, model } =
            self.respond(&plant.model, &bare, &delay_s, &drive, stamps.as_deref(), &mut rng)?;
        // A controller's loop has its noise inside.
        let outputs = if self.is_closed() && self.controller.is_some() {
            clean.clone()
        } else {
            self.all_noisy(&clean, &mut rng)?
        };
        let order = match &model {
            PlantModel::Continuous(m) => m.order(),
            PlantModel::Sampled(m) => m.order(),
        };
        let measured = if self.states { &states[..order.min(states.len())] } else { &[] };
        let states = self.all_noisy(measured, &mut rng)?;
        let bound_samples = self.bounds(&plant.model, &drive, &clean, &delay_s);
        let (input, outputs) = self.logging.read(
            (&self.inputs, &self.outputs),
            (&input, &outputs),
            stamps.as_deref(),
            self.sample_time,
            &mut rng,
        )?;
        let from = |inputs: Vec<Vec<f64>>| {
            let recording = Recording {
                inputs: inputs.into_iter().map(Into::into).collect(),
                outputs: outputs.clone(),
                states: states.iter().cloned().map(Into::into).collect(),
            };
            let (inputs, outputs) = (self.inputs.clone(), self.outputs.clone());
            let experiment =
                Experiment::new(self.sample_time, inputs, outputs, vec![recording]).ok()?;
            Some(experiment.with_model(model.clone()))
        };
        let reference = self.is_closed().then(|| from(drive)).flatten();
        let degree = self.degree(&bare);
        Ok(Record { seed, from: [from(input), reference], delay_s, degree, bound_samples })
    }

    /// The response of the plant in its loop, before noise is added to the measurement.
    fn respond(
        &self,
        plant: &PlantModel,
        bare: &StateSpace<Sampled>,
        delay_s: &[f64],
        drive: &[Vec<f64>],
        stamps: Option<&[usize]>,
        rng: &mut ChaCha8Rng,
    ) -> Result<Clean> {
        let delayed = self.sampled(plant, delay_s)?;
        let (input, model) = (drive.to_vec(), self.told(plant, bare));
        match self.key.loops {
            Loop::Open if let Some(stamps) = stamps => {
                let outputs = self.between(plant, delay_s, drive, stamps)?;
                Ok(Clean { input, outputs, states: Vec::new(), model })
            }
            Loop::Open => {
                let [outputs, states] = simulated(&delayed, drive)?;
                Ok(Clean { input, outputs, states, model })
            }
            Loop::Stabilised => {
                let [q, r] = [bare.order(), bare.inputs()].map(|n| DMatrix::identity(n, n));
                let k = dlqr(bare.a(), bare.b(), &q, &r, None)?.k;
                let [outputs, states] = simulated(&fed_back(&delayed, bare, &k)?, drive)?;
                let model = PlantModel::Sampled(bare.with_state_feedback(&k)?);
                Ok(Clean { input, outputs, states, model })
            }
            Loop::Closed => {
                let closed = match &self.controller {
                    Some(controller) => {
                        let noises = self.added_noise(&delayed, controller, drive, rng)?;
                        feedback::through(&delayed, controller, &drive[0], &noises)?
                    }
                    None => feedback::of_states(&delayed, drive)?,
                };
                Ok(Clean { input: closed.u, outputs: closed.y, states: closed.x, model })
            }
        }
    }

    /// The Cramér-Rao bound of each output, where it is known.
    fn bounds(
        &self,
        plant: &PlantModel,
        drive: &[Vec<f64>],
        clean: &[Vec<f64>],
        delay_s: &[f64],
    ) -> Vec<Option<f64>> {
        let known = self.key.loops == Loop::Open && self.exact_hold() && self.logging.is_plain();
        let of = |(output, y): (usize, &Vec<f64>)| match plant {
            PlantModel::Continuous(plant) if known => {
                let (std, ts) = (self.noise_std(y)?, self.sample_time);
                bound_samples(plant, output, drive, delay_s[0], ts, std, &self.colour)
            }
            _ => None,
        };
        clean.iter().enumerate().map(of).collect()
    }

    /// Record `seed` of events.
    fn passages(&self, seed: u64, delay_s: Vec<f64>, rng: &mut ChaCha8Rng) -> Result<Record> {
        let name = |names: &[String]| names.first().cloned().unwrap_or_default();
        let (first, second, delay) =
            (name(&self.inputs), name(&self.outputs), delay_s.first().copied().unwrap_or(0.0));
        let events = passages(
            [&first, &second],
            self.key.samples,
            delay,
            self.key.snr,
            &self.logging,
            self.sample_time,
            rng,
        )?;
        Ok(Record {
            seed,
            from: [Some(events), None],
            delay_s,
            degree: vec![vec![0]],
            bound_samples: vec![None],
        })
    }

    /// The outputs at stamps off the grid, of inputs held from stamp to stamp.
    fn between(
        &self,
        model: &PlantModel,
        delay_s: &[f64],
        drive: &[Vec<f64>],
        stamps: &[usize],
    ) -> Result<Vec<Vec<f64>>> {
        let PlantModel::Continuous(continuous) = model else { return Ok(Vec::new()) };
        let step = SampleTime::new(self.sample_time.to_seconds(1.0 / STEPS as f64))?;
        let fine =
            self.conversion.c2d(&continuous.clone().with_input_delay(delay_s.to_vec())?, step)?;
        let inputs: Vec<Vec<f64>> = drive.iter().map(|u| held(u, stamps)).collect();
        let [y, _] = simulated(&fine, &inputs)?;
        Ok(y.iter().map(|y| stamps.iter().filter_map(|t| y.get(*t)).copied().collect()).collect())
    }

    pub(super) fn is_closed(&self) -> bool {
        self.key.loops == Loop::Closed
    }

    fn delays(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let ts = self.sample_time.seconds();
        match &self.key.delay {
            Delay::Same(s) => vec![*s; self.inputs.len()],
            Delay::PerInput(all) => all.clone(),
            Delay::Drawn(Drawn { uniform_s: [from, to], whole }) => (0..self.inputs.len())
                .map(|_| {
                    if *whole {
                        let (first, last) =
                            ((from / ts).ceil() as u64, (to / ts + 1e-9).floor() as u64);
                        let drawn = rng.random_range(first..=last.max(first)) as f64;
                        drawn * ts
                    } else if from < to {
                        rng.random_range(*from..*to)
                    } else {
                        *from
                    }
                })
                .collect(),
        }
    }

    fn drive(&self, rng: &mut ChaCha8Rng) -> Result<Vec<Vec<f64>>> {
        let Some(excitation) = &self.excitation else { return Ok(Vec::new()) };
        self.inputs.iter().map(|_| Ok(excitation.generate(self.key.samples, rng)?)).collect()
    }

    fn sampled(&self, model: &PlantModel, delay_s: &[f64]) -> Result<StateSpace<Sampled>> {
        match model {
            PlantModel::Continuous(m) => Ok(self
                .conversion
                .c2d(&m.clone().with_input_delay(delay_s.to_vec())?, self.sample_time)?),
            PlantModel::Sampled(m) => {
                let whole = delay_s
                    .iter()
                    .map(|s| Ok(self.sample_time.samples(*s)?.whole))
                    .collect::<Result<Vec<_>>>()?;
                m.sample_time().must_equal(self.sample_time)?;
                Ok(m.clone().with_input_delay(whole)?)
            }
        }
    }

    /// The records come from a held input.
    fn exact_hold(&self) -> bool {
        self.key.c2d == "zoh"
    }

    /// The model that methods receive: continuous for a held input, so that fractional delays are resolvable; otherwise the simulated one.
    fn told(&self, model: &PlantModel, bare: &StateSpace<Sampled>) -> PlantModel {
        if self.exact_hold() { model.clone() } else { PlantModel::Sampled(bare.clone()) }
    }

    fn degree(&self, bare: &StateSpace<Sampled>) -> Vec<Vec<usize>> {
        let of = |output, input| {
            if self.known_degree { bare.relative_degree(output, input).unwrap_or(1) } else { 1 }
        };
        (0..bare.outputs())
            .map(|output| (0..bare.inputs()).map(|input| of(output, input)).collect())
            .collect()
    }

    fn noise_colour(&self) -> NoiseColour {
        NoiseColour::Arma { ar: self.colour.ar.clone(), ma: self.colour.ma.clone() }
    }

    /// Standard deviation of the noise's innovations on this signal; `None` without noise.
    fn noise_std(&self, clean: &[f64]) -> Option<f64> {
        if let Some(std) = self.colour.innovation_std {
            return (std > 0.0).then_some(std);
        }
        let white = self.colour.ar.is_empty() && self.colour.ma.is_empty();
        (white && self.key.snr.is_finite()).then(|| spread(clean) / self.key.snr.sqrt())
    }

    fn all_noisy(&self, clean: &[Vec<f64>], rng: &mut ChaCha8Rng) -> Result<Vec<Vec<f64>>> {
        clean.iter().map(|clean| self.noisy(clean, rng)).collect()
    }

    fn noisy(&self, clean: &[f64], rng: &mut ChaCha8Rng) -> Result<Vec<f64>> {
        if let Some(std) = self.colour.innovation_std {
            return Ok(clean
                .iter()
                .zip(self.innovations_through(clean.len(), std, rng))
                .map(|(y, v)| y + v)
                .collect());
        }
        // A state that rests has no signal-to-noise ratio, and no noise.
        if clean.iter().all(|v| Some(v) == clean.first()) {
            return Ok(clean.to_vec());
        }
        Ok(Noise {
            snr: self.key.snr,
            colour: self.noise_colour(),
            scaling: NoiseScaling::Expected,
        }
        .add(clean, rng)?)
    }

    /// White noise of this standard deviation through C/A, from rest.
    fn innovations_through(&self, samples: usize, std: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
        use rand_distr::{Distribution, StandardNormal};
        let white = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
        let e: Vec<f64> = (0..samples).map(|_| std * white(rng)).collect();
        let filter = |leading: &[f64]| {
            [1.0].into_iter().chain(leading.iter().copied()).collect::<Vec<f64>>()
        };
        feedback::filtered(&filter(&self.colour.ma), &filter(&self.colour.ar), &e)
    }

    /// The noise of a controller's loop: absolute, or in proportion to the output of the loop without noise.
    fn added_noise(
        &self,
        delayed: &StateSpace<Sampled>,
        controller: &Controller,
        drive: &[Vec<f64>],
        rng: &mut ChaCha8Rng,
    ) -> Result<Vec<f64>> {
        let samples = self.key.samples;
        if let Some(std) = self.colour.innovation_std {
            return Ok(self.innovations_through(samples, std, rng));
        }
        if self.key.snr.is_infinite() {
            return Ok(vec![0.0; samples]);
        }
        let quiet = feedback::through(delayed, controller, &drive[0], &vec![0.0; samples])?;
        let level = spread(&quiet.y[0]) / self.key.snr.sqrt();
        Ok(unit_noise(samples, &self.noise_colour(), rng)?.into_iter().map(|v| level * v).collect())
    }
}

fn spread(x: &[f64]) -> f64 {
    stats::variance(x).unwrap_or(0.0).sqrt()
}

/// 53 bits of SHA-256: a seed reads alike wherever numbers are doubles.
fn hash(text: &str) -> u64 {
    Sha256::digest(text.as_bytes())
        .iter()
        .take(8)
        .fold(0, |seed, byte| (seed << 8) | u64::from(*byte))
        >> 11
}

/// Digest of the definitions behind the names of a key in this plan, and of all other inputs of its answers.
fn definition(plan: &Plan, grid: &Grid, key: &Key, signal: &Signal) -> Result<String> {
    let Scoring { invalid_samples, wrong_samples, .. } = grid.scoring;
    let noise = plan.noises.get(&key.noise);
    let controller = key.controller.as_ref().and_then(|c| plan.controllers.get(c));
    let listed = PLANTS.iter().any(|p| p.name == key.plant);
    let path = plan.folder.join(&key.plant);
    let file = if listed { String::new() } else { read_text(&path)? };
    let mut all = serde_json::json!([
        signal,
        noise,
        controller,
        file,
        grid.detrend,
        grid.known_degree,
        invalid_samples,
        wrong_samples
    ]);
    if let (Some(list), Some(logging)) = (all.as_array_mut(), plan.loggings.get(&key.logging)) {
        list.push(serde_json::json!(logging));
    }
    Ok(format!("{:016x}", hash(&all.to_string())))
}

fn source(name: &str, folder: &Path) -> Result<(PlantSource, Vec<String>, Vec<String>)> {
    if let Some(entry) = PLANTS.iter().find(|p| p.name == name) {
        // Names do not depend on the draws.
        let plant = entry.build(&mut ChaCha8Rng::seed_from_u64(0))?;
        return Ok((PlantSource::Listed(entry), plant.inputs, plant.outputs));
    }
    let path = folder.join(name);
    let refused = |plan: String, detail: String| Err(StudyError::Plan { plan, detail }.into());
    if !path.exists() {
        let known: Vec<&str> = PLANTS.iter().map(|p| p.name).collect();
        let detail = format!(
            "there is no plant `{name}`, and no model file of that name; there are: {}",
            known.join(", ")
        );
        return refused(name.to_owned(), detail);
    }
    let file = ModelFile::read(&path)?;
    let model = if file.is_sampled() {
        PlantModel::Sampled(file.sampled()?)
    } else {
        PlantModel::Continuous(file.continuous()?)
    };
    if file.input_delay_s.iter().any(|d| *d != 0.0) || !file.effects.is_empty() {
        let detail = "a plant of a study has no dead time and no effects of its own: take them out of the model file, and inject delays with `delay_s`";
        return refused(path.display().to_string(), detail.to_owned());
    }
    let names = |channels: &[deadtime_model::Channel]| {
        channels.iter().map(|c| c.name.clone()).collect::<Vec<_>>()
    };
    let (inputs, outputs) = (names(&file.inputs), names(&file.outputs));
    let plant = Plant { model, inputs: inputs.clone(), outputs: outputs.clone() };
    Ok((PlantSource::File(Box::new(plant)), inputs, outputs))
}

/// Outputs and states of a plant that rests before the first sample.
fn simulated(sys: &StateSpace<Sampled>, inputs: &[Vec<f64>]) -> Result<[Vec<Vec<f64>>; 2]> {
    let u = DMatrix::from_fn(inputs.first().map_or(0, Vec::len), inputs.len(), |t, j| inputs[j][t]);
    let options = Options {
        initial: Some(DVector::zeros(sys.order())),
        prehistory: Prehistory::Rest,
        ..Options::default()
    };
    let response = lsim(sys, &u, sys.sample_time(), &options)?;
    let columns = |m: &DMatrix<f64>| m.column_iter().map(|c| c.iter().copied().collect()).collect();
    Ok([columns(&response.y), columns(&response.x)])
}

/// The delayed plant with feedback that is not delayed: a fraction of a sample adds states after the plant's own, which K does not see.
fn fed_back(
    delayed: &StateSpace<Sampled>,
    bare: &StateSpace<Sampled>,
    k: &DMatrix<f64>,
) -> Result<StateSpace<Sampled>> {
    let n = bare.order();
    let (mut a, mut c) = (delayed.a().clone(), delayed.c().clone());
    let mut upper = a.view_mut((0, 0), (n, n));
    upper -= bare.b() * k;
    let mut left = c.view_mut((0, 0), (bare.outputs(), n));
    left -= bare.d() * k;
    Ok(StateSpace::sampled(a, delayed.b().clone(), c, delayed.d().clone(), delayed.sample_time())?
        .with_input_delay(delayed.input_delay().to_vec())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Resolved;

    /// Outputs of the first record of every setting of a grid.
    fn outputs(plan: &mut Plan, grid: &str) -> Vec<Vec<f64>> {
        plan.only(&[grid.to_owned()], &[]).unwrap();
        let record = |s: &Setting| s.record(plan.seed, 0).unwrap().from[0].take().unwrap();
        Resolved::new(plan)
            .unwrap()
            .settings
            .iter()
            .map(|s| record(s).recordings()[0].outputs[0].values.to_vec())
            .collect()
    }

    fn power(x: impl Iterator<Item = f64>) -> f64 {
        x.map(|v| v * v).sum()
    }

    #[test]
    fn the_loops_have_the_published_ratios_of_power() {
        let mut plan = Plan::open("bjorklund").unwrap();
        let noisy = outputs(&mut plan, "closed");
        plan.noises.values_mut().for_each(|n| n.innovation_std = Some(0.0));
        let quiet = outputs(&mut plan, "closed");
        assert_eq!(noisy.len(), 18);
        // Björklund (2003), p. 75: 790 to 1147; 2000 samples of a noise tell its power to 5 %, a slow one's to 10 %.
        for (noisy, quiet) in noisy.iter().zip(&quiet) {
            let ratio =
                power(quiet.iter().copied()) / power(noisy.iter().zip(quiet).map(|(a, b)| a - b));
            assert!(ratio > 0.85 * 790.0 && ratio < 1.15 * 1147.0, "{ratio}");
        }
    }

    #[test]
    fn the_unrelated_output_is_its_noise_whatever_the_input() {
        let mut plan = Plan::open("unrelated").unwrap();
        // The output holds nothing of inputs of size 1. Noise of 1e-9 avoids a constant output, which would be refused.
        plan.noises.values_mut().for_each(|n| n.innovation_std = Some(1e-9));
        let quiet = outputs(&mut plan, "unrelated");
        assert_eq!(quiet.len(), 9);
        assert!(quiet.iter().flatten().all(|y| y.abs() < 1e-6));
    }
}
