//! The thesis' way from flights to physical parameters, many times over: a quadrotor flies in a loop, its response is identified without structure (PBSIDopt), and the
//! structured model is matched to it by frequency. Bias, spread and coverage of every parameter, as tables in Markdown.
//!
//! `cargo run --release --package deadtime-lab --bin match_study -- [TRIALS] [FIRST SEED]`; `lab/study matching` writes them into the documents.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use deadtime::identify::Identifier;
use deadtime::identify::matching::{Matched, Matching, Target};
use deadtime::identify::structured::Standing;
use deadtime::identify::subspace::{Direct, Pbsidopt, Recordings, Settings};
use deadtime::log::{Channel, Log};
use deadtime::model::c2d::{Conversion, ZeroOrderHold};
use deadtime::model::uav::Dynamics;
use deadtime::model::{EquationsFile, ModelDocument, Sampled, StateSpace, dlqr};
use deadtime::progress::HowFar;
use deadtime::time::SampleTime;
use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

const SAMPLE_TIME_S: f64 = 0.02;
/// A flight of a minute.
const SAMPLES: usize = 3000;
/// Weight of the command in the regulator, that of every state being 1.
const COMMAND: f64 = 100.0;
/// The pushes of the reference, their chance of changing sign at a sample, and standard deviations: of gusts on every state, of what the regulator sees, of the outputs.
const PUSH: f64 = 0.05;
const TURNS: f64 = 0.1;
const GUST: f64 = 0.002;
const SEEN: f64 = 0.01;
const OUTPUTS: [f64; 2] = [0.02, 0.05];
/// The file's values, over the true ones.
const OFF: [f64; 6] = [1.4, 0.7, 1.3, 0.6, 0.8, 1.25];

/// A dynamics with its derivatives: name, unit, value; those that are 0 in the thesis last.
struct Craft {
    dynamics: Dynamics,
    text: &'static str,
    parameters: &'static [(&'static str, f64)],
}

const CRAFTS: [Craft; 4] = [
    Craft {
        dynamics: Dynamics::Lateral,
        text: "[derivatives]\nv = \"Yv*v + Yp*p_x + 9.81*phi + Yd*delta_lat\"\np_x = \"Lv*v + Lp*p_x + Ld*delta_lat\"\nphi = \"p_x\"\n\
               [output_equations]\np = \"p_x\"\nay = \"Yv*v + Yp*p_x + Yd*delta_lat\"\n",
        parameters: &[
            ("Yv", -0.211),
            ("Lv", -3.613),
            ("Yd", 9.379),
            ("Ld", 851.287),
            ("Yp", 0.0),
            ("Lp", 0.0),
        ],
    },
    Craft {
        dynamics: Dynamics::Longitudinal,
        text: "[derivatives]\nu = \"Xu*u + Xq*q_x - 9.81*theta + Xd*delta_lon\"\nq_x = \"Mu*u + Mq*q_x + Md*delta_lon\"\ntheta = \"q_x\"\n\
               [output_equations]\nq = \"q_x\"\nax = \"Xu*u + Xq*q_x + Xd*delta_lon\"\n",
        parameters: &[
            ("Xu", -0.282),
            ("Mu", 6.297),
            ("Xd", -8.758),
            ("Md", 473.061),
            ("Xq", 0.0),
            ("Mq", 0.0),
        ],
    },
    Craft {
        dynamics: Dynamics::Directional,
        text: "[derivatives]\nr_x = \"Nr*r_x + Nd*delta_dir\"\npsi = \"r_x\"\n[output_equations]\nr = \"r_x\"\n",
        parameters: &[("Nr", -8.178), ("Nd", 255.59)],
    },
    Craft {
        dynamics: Dynamics::Vertical,
        text: "[derivatives]\nw = \"Zw*w + Zd*delta_ver\"\n[output_equations]\naz = \"Zw*w + Zd*delta_ver\"\n",
        parameters: &[("Zw", -0.731), ("Zd", -34.35)],
    },
];

impl Craft {
    /// The structured model; `off`: with values that are not the true ones.
    fn file(&self) -> Result<EquationsFile, Box<dyn Error>> {
        let states: Vec<String> = self
            .dynamics
            .states()
            .iter()
            .map(|(n, _)| {
                // An output's name cannot be a state's.
                let output = self.dynamics.outputs().iter().any(|(o, _)| o == n);
                if output { format!("{n}_x = {{}}") } else { format!("{n} = {{}}") }
            })
            .collect();
        let outputs: Vec<String> =
            self.dynamics.outputs().iter().map(|(n, _)| format!("{{ name = \"{n}\" }}")).collect();
        let parameters: Vec<String> = self
            .parameters
            .iter()
            .zip(OFF)
            .map(|((n, v), off)| format!("{n} = {{ value = {:?} }}", v * off))
            .collect();
        let text = format!(
            "format = \"deadtime/model@1\"\nname = \"{}\"\nkind = \"equations\"\ninputs = [{{ name = \"{}\" }}]\noutputs = [{}]\n[states]\n{}\n[parameters]\n{}\n{}",
            self.dynamics.name(),
            self.dynamics.input(),
            outputs.join(", "),
            states.join("\n"),
            parameters.join("\n"),
            self.text
        );
        match ModelDocument::from_toml(&text, Path::new(self.dynamics.name()))? {
            ModelDocument::Equations(file) => Ok(file),
            ModelDocument::Lti(_) => Err("equations".into()),
        }
    }

    /// A minute in a loop: the regulator sees noisy states one sample late.
    fn flight(&self, plant: &StateSpace<Sampled>, seed: u64) -> Result<Log, Box<dyn Error>> {
        let (n, outputs) = (plant.order(), plant.outputs());
        let late = plant.clone().with_input_delay(vec![1])?.with_delays_as_states()?;
        let gain = dlqr(
            late.a(),
            late.b(),
            &DMatrix::identity(n + 1, n + 1),
            &DMatrix::from_element(1, 1, COMMAND),
            None,
        )?
        .k;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(self.dynamics as u64);
        let (mut x, mut u, mut push) = (DVector::zeros(n), 0.0, PUSH);
        let (mut inputs, mut measured) = (Vec::new(), vec![Vec::new(); outputs]);
        for _ in 0..SAMPLES {
            if random.random_bool(TURNS) {
                push = -push;
            }
            let mut normal = |std: f64| std * random.sample::<f64, _>(StandardNormal);
            let y = plant.c() * &x + plant.d() * u;
            inputs.push(u);
            measured
                .iter_mut()
                .enumerate()
                .for_each(|(i, channel)| channel.push(y[i] + normal(OUTPUTS[i])));
            let seen = DVector::from_fn(n + 1, |i, _| if i < n { x[i] + normal(SEEN) } else { u });
            x = plant.a() * &x + plant.b() * u + DVector::from_fn(n, |_, _| normal(GUST));
            u = push - (&gain * seen)[0];
        }
        let time = (0..SAMPLES).map(|k| k as f64 * SAMPLE_TIME_S).collect();
        let mut channels = vec![Channel::new(self.dynamics.input(), None, inputs)];
        channels.extend(
            self.dynamics
                .outputs()
                .iter()
                .zip(measured)
                .map(|((name, _), values)| Channel::new(*name, None, values)),
        );
        Ok(Log::new(format!("{} {seed}", self.dynamics.name()), time, channels)?)
    }

    /// From one flight to its parameters: the twelve, then all sixteen.
    fn trial(
        &self,
        plant: &StateSpace<Sampled>,
        file: &EquationsFile,
        seed: u64,
    ) -> Result<Vec<Matched>, Box<dyn Error>> {
        let outputs: Vec<String> =
            self.dynamics.outputs().iter().map(|(n, _)| (*n).to_owned()).collect();
        let records = Recordings::from_logs(
            &[self.flight(plant, seed)?],
            &[self.dynamics.input().to_owned()],
            &outputs,
        )?;
        // The heading is not seen.
        let order = if self.dynamics == Dynamics::Directional { 1 } else { plant.order() };
        let direct = if plant.d().amax() > 0.0 { Direct::Free } else { Direct::None };
        let found = Pbsidopt(Settings { order: Some(order), direct, ..Settings::default() })
            .identify(&records, &HowFar::default())?;
        let target = Target::from_identified("flight", &found, &[0])?;
        let named = |all: bool| {
            self.parameters
                .iter()
                .filter(|(_, v)| all || *v != 0.0)
                .map(|(n, _)| (*n).to_owned())
                .collect::<Vec<_>>()
        };
        let fit = |all: bool| {
            Matching { free: named(all), starts: 2, ..Matching::default() }.fit(file, &target)
        };
        let mut answers = vec![fit(false)?];
        if named(true).len() > named(false).len() {
            answers.push(fit(true)?);
        }
        Ok(answers)
    }
}

/// What the trials said of a parameter.
#[derive(Default)]
struct Told {
    values: Vec<f64>,
    stds: Vec<f64>,
    held: usize,
    open: usize,
}

impl Told {
    /// What these matches said of the parameter of this name and true value.
    fn of<'a>(name: &str, truth: f64, matches: impl Iterator<Item = &'a Matched>) -> Self {
        let mut told = Self::default();
        for found in matches {
            let Some(p) = found.parameters.iter().find(|p| p.name == name) else {
                continue;
            };
            told.values.push(p.value);
            told.stds.push(p.std.unwrap_or(f64::NAN));
            told.held +=
                usize::from(p.interval.is_some_and(|[from, to]| from <= truth && truth <= to));
            told.open += usize::from(p.standing == Standing::Open);
        }
        told
    }

    /// The parameter's row of the table.
    fn print(&self, name: &str, truth: f64) {
        let count = self.values.len() as f64;
        let mean = self.values.iter().sum::<f64>() / count;
        let spread = (self.values.iter().map(|v| (v - mean).powi(2)).sum::<f64>()
            / (count - 1.0).max(1.0))
        .sqrt();
        let mut stds = self.stds.clone();
        stds.sort_by(f64::total_cmp);
        let typical = stds[stds.len() / 2];
        let size = |v: f64| {
            if truth == 0.0 {
                format!("{v:.4}")
            } else {
                format!("{:.2} %", 100.0 * v / truth.abs())
            }
        };
        println!(
            "| {name} | {truth} | {} | {} | {} | {:.0} % | {:.0} % |",
            size(mean - truth),
            size(spread),
            size(typical),
            100.0 * self.held as f64 / count,
            100.0 * self.open as f64 / count
        );
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let trials: u64 = words.next().map_or(Ok(100), |w| w.parse())?;
    let first: u64 = words.next().map_or(Ok(1), |w| w.parse())?;
    let titles = ["The twelve, by least squares (`wls`)", "All sixteen"];
    let mut tables: [Vec<(&str, f64, Told)>; 2] = Default::default();
    let (mut failed, mut unseen, mut trades) =
        (0, BTreeMap::<String, usize>::new(), BTreeMap::<String, usize>::new());
    for craft in &CRAFTS {
        let plant =
            ZeroOrderHold {}.c2d(&craft.dynamics.model(), SampleTime::new(SAMPLE_TIME_S)?)?;
        let file = craft.file()?;
        let run = |seed: u64| craft.trial(&plant, &file, seed).map_err(|e| e.to_string());
        let all: Vec<Result<Vec<Matched>, String>> =
            (first..first + trials).into_par_iter().map(run).collect();
        for (at, table) in tables.iter_mut().enumerate() {
            for (name, truth) in craft.parameters {
                let told = Told::of(name, *truth, all.iter().flatten().filter_map(|a| a.get(at)));
                if !told.values.is_empty() {
                    table.push((name, *truth, told));
                }
            }
        }
        failed += all.iter().filter(|a| a.is_err()).count();
        all.iter()
            .filter_map(|a| a.as_ref().err())
            .take(1)
            .for_each(|e| eprintln!("{}: {e}", craft.dynamics.name()));
        for found in all.iter().flatten().filter_map(|a| a.get(1)) {
            found.unseen.iter().for_each(|u| *unseen.entry(u.words.clone()).or_default() += 1);
            // The numbers of a trade differ from flight to flight; the pair does not.
            found.trades.iter().for_each(|t| {
                *trades.entry(t.split(" trade").next().unwrap_or(t).to_owned()).or_default() += 1
            });
        }
    }
    println!(
        "{trials} flights of each dynamics, {failed} without an answer. Deviations in shares of the true value where it is not 0.\n"
    );
    for (title, table) in titles.iter().zip(&tables) {
        println!("## {title}\n");
        println!(
            "| parameter | true | bias | spread | told (median) | held by the interval of 95 % | told to be open |"
        );
        println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
        for (name, truth, told) in table {
            told.print(name, *truth);
        }
        println!();
    }
    println!(
        "Of all sixteen, combinations that cannot be had, and pairs that trade, with the number of flights:\n"
    );
    for (what, count) in unseen.iter().chain(&trades) {
        println!("- {what}: {count}");
    }
    if unseen.is_empty() && trades.is_empty() {
        println!("- none");
    }
    Ok(())
}
