//! How often an open record is said to be of a loop, how often a loop is seen, and how often the verdict's interval holds the dead time in a loop: tables in Markdown.
//!
//! `cargo run --release --package deadtime-lab --bin loop_study -- [DRAWS] [FIRST SEED]`; `lab/study loop` writes them into the documents.

use std::collections::BTreeMap;
use std::error::Error;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

use deadtime::delay::{Job, Record, Scope, chosen, in_loop, lead};
use deadtime::log::{Channel, Log};
use deadtime::signal::excitation::EXCITATIONS;
use deadtime::signal::{Noise, NoiseColour};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

/// Steps of the integration within a sample.
const FINE: usize = 20;
/// Samples after which an excitation of fixed shape is given again.
const AGAIN: usize = 250;
/// The window of the search, samples.
const WINDOW: usize = 35;
/// Methods that are asked for the verdict: quick ones of every class.
const METHODS: [&str; 11] = [
    "oestruc",
    "arxstruc",
    "delayest",
    "met1struc",
    "oe_posterior",
    "p1d",
    "p2d",
    "impulseest",
    "arxdap",
    "lagudap",
    "fischer",
];

/// A gain of one behind two lags and a dead time, all in samples.
struct Plant {
    lags: [f64; 2],
    delay: f64,
}

impl Plant {
    fn draw(rng: &mut ChaCha8Rng) -> Self {
        let second = if rng.random_bool(0.5) { rng.random_range(0.5..3.0) } else { 0.0 };
        Self { lags: [rng.random_range(2.0..8.0), second], delay: rng.random_range(0.1..8.0) }
    }

    /// The gain at which the loop with a proportional controller that is `late` samples late begins to oscillate, and the frequency, rad by sample.
    fn ultimate(&self, late: f64) -> (f64, f64) {
        let phase = |w: f64| {
            self.lags.iter().map(|t| (w * t).atan()).sum::<f64>() + w * (self.delay + 0.5 + late)
        };
        let w = (1..3000).map(|i| 1e-3 * f64::from(i)).find(|w| phase(*w) >= PI).unwrap_or(3.0);
        (self.lags.iter().map(|t| (1.0 + (w * t).powi(2)).sqrt()).product(), w)
    }
}

/// What a plant answers to commands given one at a time.
struct Running<'a> {
    plant: &'a Plant,
    /// Commands on the fine grid.
    given: Vec<f64>,
    states: [f64; 2],
}

impl<'a> Running<'a> {
    fn new(plant: &'a Plant) -> Self {
        Self { plant, given: Vec::new(), states: [0.0; 2] }
    }

    /// The output at the end of the sample in which `command` is held.
    fn step(&mut self, command: f64) -> f64 {
        let later = (self.plant.delay * FINE as f64).round() as usize;
        for _ in 0..FINE {
            self.given.push(command);
            let mut x = self.given.len().checked_sub(later + 1).map_or(0.0, |i| self.given[i]);
            for (state, lag) in self.states.iter_mut().zip(self.plant.lags) {
                *state = if lag > 0.0 {
                    x + (*state - x) * (-1.0 / (lag * FINE as f64)).exp()
                } else {
                    x
                };
                x = *state;
            }
        }
        self.states[1]
    }
}

fn colour(number: usize) -> NoiseColour {
    match number {
        0 => NoiseColour::White,
        1 => NoiseColour::Ar { coefficients: vec![-0.9] },
        _ => NoiseColour::Arma { ar: vec![-1.5, 0.8], ma: vec![0.3] },
    }
}

/// Noise of unit variance.
fn noise(samples: usize, number: usize, rng: &mut ChaCha8Rng) -> Result<Vec<f64>, Box<dyn Error>> {
    let still = vec![0.0; samples];
    let carrier: Vec<f64> = (0..samples).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let with = Noise { snr: 1.0, colour: colour(number), ..Noise::default() }.add(&carrier, rng)?;
    let only: Vec<f64> = with.iter().zip(&carrier).zip(&still).map(|((y, c), _)| y - c).collect();
    Ok(scaled(&only, 1.0 / deviation(&only).max(1e-12)))
}

fn deviation(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt()
}

fn scaled(x: &[f64], by: f64) -> Vec<f64> {
    x.iter().map(|v| v * by).collect()
}

fn without_mean(x: &[f64]) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    x.iter().map(|v| v - mean).collect()
}

/// An excitation by its name, given again and again where its shape is fixed; `None` where it cannot be that long. `noise` is slow noise.
fn excite(name: &str, samples: usize, rng: &mut ChaCha8Rng) -> Option<Vec<f64>> {
    if name == "noise" {
        return noise(samples, 1, rng).ok();
    }
    let entry = EXCITATIONS.iter().find(|e| e.name == name)?;
    let options = if name == "prbs" {
        serde_json::json!({ "order": 9, "clock": 3 })
    } else {
        serde_json::json!({})
    };
    let signal = entry.with(options).ok()?;
    let fixed = ["two_ramps", "impulse", "step", "staircase", "doublet", "three_two_one_one"]
        .contains(&name);
    let short = signal.generate(if fixed { AGAIN } else { samples }, rng).ok()?;
    Some((0..samples).map(|k| short[k % short.len()]).collect())
}

/// A record without feedback: its input and its noisy output, whose gain falls by a fifth at its largest where the plant is `bent`.
fn open(name: &str, bent: bool, rng: &mut ChaCha8Rng) -> Option<(Vec<f64>, Vec<f64>)> {
    let samples = [500, 1000, 2000, 8000][rng.random_range(0..4)];
    let u = excite(name, samples, rng)?;
    let plant = Plant::draw(rng);
    let mut running = Running::new(&plant);
    let mut y = vec![0.0];
    y.extend(u[..samples - 1].iter().map(|c| running.step(*c)));
    if bent {
        let peak = y.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        y.iter_mut().for_each(|v| *v *= 1.0 - 0.2 * (*v / peak).powi(2));
    }
    let snr: f64 = [1.0, 10.0, 100.0, 1e4][rng.random_range(0..4)];
    let e = scaled(&noise(samples, rng.random_range(0..3), rng).ok()?, deviation(&y) / snr.sqrt());
    Some((u, y.iter().zip(&e).map(|(y, e)| y + e).collect()))
}

/// A record of a loop.
struct Closed {
    u: Vec<f64>,
    y: Vec<f64>,
    delay: f64,
    /// Share of the input's variance that the output's noise makes.
    by_noise: f64,
    /// The controller answers within the sample.
    at_once: bool,
}

/// A proportional or PI controller around a plant, its reference moved as `reference` says.
fn closed(reference: &str, rng: &mut ChaCha8Rng) -> Option<Closed> {
    let samples = [500, 1000, 2000][rng.random_range(0..3)];
    let plant = Plant::draw(rng);
    let at_once = rng.random_bool(0.5);
    let (ultimate, w) = plant.ultimate(if at_once { 0.0 } else { 1.0 });
    let gain = rng.random_range(0.25..0.6) * ultimate.min(20.0);
    let integral = if rng.random_bool(0.5) { gain * w / TAU } else { 0.0 };
    let r = if reference == "none" { vec![0.0; samples] } else { excite(reference, samples, rng)? };
    let r = scaled(&r, 1.0 / deviation(&r).max(1e-12));
    let level = if reference == "none" { 1.0 } else { 10_f64.powf(rng.random_range(-1.3..0.3)) };
    let e = scaled(&noise(samples, rng.random_range(0..3), rng).ok()?, level);
    let run = |r: &[f64], e: &[f64]| {
        let (mut running, mut sum, mut past) = (Running::new(&plant), 0.0, 0.0);
        let (mut u, mut y, mut clean) =
            (Vec::with_capacity(samples), Vec::with_capacity(samples), 0.0);
        for (r, e) in r.iter().zip(e) {
            let measured = clean + e;
            let error = r - if at_once { measured } else { past };
            past = measured;
            sum += integral * error;
            let command = gain * error + sum;
            u.push(command);
            y.push(measured);
            clean = running.step(command);
        }
        (u, y)
    };
    let (u, y) = run(&r, &e);
    let (alone, _) = run(&vec![0.0; samples], &e);
    let bounded = u.iter().all(|v| v.is_finite() && v.abs() < 1e6);
    bounded.then(|| Closed {
        by_noise: (deviation(&alone) / deviation(&u)).powi(2),
        u,
        y,
        delay: plant.delay,
        at_once,
    })
}

fn percent(part: usize, of: usize) -> String {
    if of == 0 {
        "–".to_owned()
    } else {
        format!("{:.1} % of {of}", 100.0 * part as f64 / of as f64)
    }
}

/// The verdict's interval, s, at a sample time of 1 s.
fn verdict(u: &[f64], y: &[f64]) -> Result<Option<[f64; 2]>, Box<dyn Error + Send + Sync>> {
    let time_s = (0..u.len()).map(|k| k as f64).collect();
    let log = Log::new(
        "draw",
        time_s,
        vec![Channel::new("u", None, u.to_vec()), Channel::new("y", None, y.to_vec())],
    )?;
    let methods = chosen(&METHODS.map(str::to_owned), &BTreeMap::new(), &[Scope::Pair])?;
    let report = Job { methods, ..Job::new(vec![log], ["u"], ["y"]) }.run()?;
    Ok(report.pairs.first().and_then(|p| p.verdict.ci95_s))
}

/// Parts of the input's variance that noise makes: the rows of the tables.
const PARTS: [(&str, f64, f64); 4] = [
    ("less than 1 %", 0.0, 0.01),
    ("1 to 5 %", 0.01, 0.05),
    ("5 to 50 %", 0.05, 0.5),
    ("more than 50 %", 0.5, 2.0),
];

/// Counts of open records: linear ones said to be of a loop, linear ones, bent ones said to be of a loop, bent ones, and those whose output is said to lead.
fn open_counts(name: &str, draws: Range<u64>) -> [usize; 5] {
    let seen: Vec<(bool, bool, bool)> = draws
        .into_par_iter()
        .filter_map(|seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let bent = rng.random_bool(0.5);
            let (u, y) = open(name, bent, &mut rng)?;
            let record = [Record::new(without_mean(&u), without_mean(&y))];
            Some((bent, in_loop(&record, WINDOW, 1).closed(), lead(&record, WINDOW, 1).is_some()))
        })
        .collect();
    let count = |f: &dyn Fn(&(bool, bool, bool)) -> bool| seen.iter().filter(|s| f(s)).count();
    [
        count(&|s| !s.0 && s.1),
        count(&|s| !s.0),
        count(&|s| s.0 && s.1),
        count(&|s| s.0),
        count(&|s| s.2),
    ]
}

/// The table of open records, by excitation.
fn print_open(draws: &Range<u64>) {
    println!(
        "## Open records\n\nRecords of 500 to 8000 samples without feedback that are said to be of a loop, and those whose output is said to lead, by excitation; one or"
    );
    println!(
        "two lags, three colours of noise, signal-to-noise ratios of 1 to 10 000, plants that are linear and plants whose gain falls by a fifth.\n"
    );
    println!(
        "| excitation | linear: a loop | bent: a loop | leads |\n| --- | ---: | ---: | ---: |"
    );
    let names: Vec<&str> = EXCITATIONS.iter().map(|e| e.name).chain(["noise"]).collect();
    let mut total = [0; 5];
    for name in &names {
        let row = open_counts(name, draws.clone());
        println!(
            "| {name} | {} | {} | {} |",
            percent(row[0], row[1]),
            percent(row[2], row[3]),
            percent(row[4], row[1] + row[3])
        );
        total.iter_mut().zip(row).for_each(|(t, r)| *t += r);
    }
    println!(
        "| all | {} | {} | {} |\n",
        percent(total[0], total[1]),
        percent(total[2], total[3]),
        percent(total[4], total[1] + total[3])
    );
}

/// The references of loops.
const REFERENCES: [&str; 8] =
    ["rbs", "prbs", "noise", "multisine", "chirp", "doublet", "step", "none"];

/// The record of a loop, drawn by its seed.
fn drawn_loop(seed: u64, reference: &str) -> Option<Closed> {
    closed(reference, &mut ChaCha8Rng::seed_from_u64(seed))
}

/// The table of loops that are seen, by reference and by the noise's part of the input.
fn print_loops(draws: &Range<u64>) {
    println!(
        "## Loops\n\nRecords of 500 to 2000 samples in which a controller makes the input from the output, within the sample or one later, and those that are said to be of a"
    );
    println!(
        "loop, by the reference and by how much of the input's variance the output's noise makes (where that is little, so is the error of a method made for open records).\n"
    );
    println!(
        "| reference | {} |\n| --- | {}",
        PARTS.map(|p| p.0).join(" | "),
        "---: | ".repeat(PARTS.len()).trim_end()
    );
    let mut sum = [[0; 2]; 4];
    for reference in REFERENCES {
        let seen: Vec<(f64, bool)> = draws
            .clone()
            .into_par_iter()
            .filter_map(|seed| {
                let c = drawn_loop(seed, reference)?;
                let record = [Record::new(without_mean(&c.u), without_mean(&c.y))];
                Some((c.by_noise, in_loop(&record, WINDOW, 1).closed()))
            })
            .collect();
        let mut row = Vec::new();
        for (i, (_, from, to)) in PARTS.iter().enumerate() {
            let all: Vec<&(f64, bool)> =
                seen.iter().filter(|s| s.0 >= *from && s.0 < *to).collect();
            let found = all.iter().filter(|s| s.1).count();
            sum[i] = [sum[i][0] + found, sum[i][1] + all.len()];
            row.push(percent(found, all.len()));
        }
        println!("| {reference} | {} |", row.join(" | "));
    }
    println!("| all | {} |\n", sum.map(|[found, all]| percent(found, all)).join(" | "));
}

/// Numbers of records, of verdicts and of those that hold the dead time, and the median width; for controllers that answer within the sample, or later.
fn answers(
    reference: &str,
    within_sample: bool,
    draws: Range<u64>,
) -> (usize, usize, usize, String) {
    let seen: Vec<Option<(bool, f64)>> = draws
        .into_par_iter()
        .filter_map(|seed| drawn_loop(seed, reference).filter(|c| c.at_once == within_sample))
        .map(|c| {
            let told = verdict(&c.u, &c.y).ok().flatten();
            told.map(|[from, to]| ((from - 1e-9..=to + 1e-9).contains(&c.delay), to - from))
        })
        .collect();
    let answers: Vec<(bool, f64)> = seen.iter().flatten().copied().collect();
    let held = answers.iter().filter(|a| a.0).count();
    let mut widths: Vec<f64> = answers.iter().map(|a| a.1).collect();
    widths.sort_by(f64::total_cmp);
    let width = widths.get(widths.len() / 2).map_or("–".to_owned(), |w| format!("{w:.1}"));
    (seen.len(), answers.len(), held, width)
}

/// The table of verdicts in loops.
fn print_verdicts(draws: &Range<u64>) {
    println!(
        "## Verdicts in a loop\n\nThe same draws (a quarter of them): records that get a verdict, those of them whose interval holds the dead time, and its median width, samples.\n"
    );
    println!(
        "| reference | the controller answers | answered | holds | width |\n| --- | --- | ---: | ---: | ---: |"
    );
    let mut all = [0; 3];
    for reference in REFERENCES {
        for (when, wanted) in [("within the sample", true), ("a sample later", false)] {
            let (drawn, answered, held, width) = answers(reference, wanted, draws.clone());
            println!(
                "| {reference} | {when} | {} | {} | {width} |",
                percent(answered, drawn),
                percent(held, answered)
            );
            all = [all[0] + drawn, all[1] + answered, all[2] + held];
        }
    }
    println!("| all | | {} | {} | |", percent(all[1], all[0]), percent(all[2], all[1]));
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let draws: u64 = arguments.next().map_or(Ok(100), |a| a.parse())?;
    let first: u64 = arguments.next().map_or(Ok(3_000_000), |a| a.parse())?;
    print_open(&(first..first + draws));
    print_loops(&(first..first + draws));
    print_verdicts(&(first..first + draws.div_ceil(4)));
    Ok(())
}
