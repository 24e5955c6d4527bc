//! The cells of a plan: what one number of a table is of.

use serde_json::Value;

use super::error::{Result, StudyError};
use super::keys::{Delay, Loop, Place};
use super::passages::EVENTS;
use super::plan::{Grid, PLAIN, Plan, spelt_out};
use super::setting::{Key, Setting};
use deadtime_delay::{DelayEstimator, METHODS, Method, Scope};
use deadtime_signal::registry;

/// A method with options that differ from its defaults.
pub(super) struct Chosen {
    pub(super) method: &'static Method,
    pub(super) options: Value,
    pub(super) estimator: Box<dyn DelayEstimator>,
}

/// One cell: a setting, a place, a pair and a method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Slot {
    pub(super) setting: usize,
    pub(super) place: Place,
    pub(super) input: usize,
    /// `None`: all outputs together, by a method of measured states.
    pub(super) output: Option<usize>,
    /// Counted in the grid's own list.
    pub(super) method: usize,
}

/// A plan with everything that it names looked up.
pub(super) struct Resolved {
    pub(super) settings: Vec<Setting>,
    /// By grid.
    pub(super) methods: Vec<Vec<Chosen>>,
    pub(super) slots: Vec<Slot>,
    /// The first slot of every setting, and the number of all.
    pub(super) first: Vec<usize>,
}

/// The methods fit the kind of the excitation, and the records are long enough for the search.
fn fits(grid: &Grid, key: &Key, chosen: &[Chosen]) -> Result<(), String> {
    let events = key.excitation == EVENTS;
    if let Some(other) = chosen.iter().find(|c| (c.method.scope == Scope::Events) != events) {
        let (name, sees) = (other.method.entry.name, if events { "samples" } else { "events" });
        return Err(format!(
            "{}: method `{name}` looks at {sees}, the excitation is `{}`: give them grids of their own",
            grid.name, key.excitation
        ));
    }
    match grid.max_delay.iter().find(|max_delay| key.samples <= **max_delay && !events) {
        Some(max_delay) => Err(format!(
            "{}: records of {} samples are too short for a search up to max_delay = {max_delay}",
            grid.name, key.samples
        )),
        None => Ok(()),
    }
}

/// The slots of a setting: by place, method, input and output.
fn slots_of(number: usize, setting: &Setting, grid: &Grid, methods: &[Chosen]) -> Vec<Slot> {
    let wanted = |name: &String| grid.output.is_empty() || grid.output.contains(name);
    let outputs: Vec<Option<usize>> =
        (0..setting.outputs.len()).filter(|&o| wanted(&setting.outputs[o])).map(Some).collect();
    let mut slots = Vec::new();
    for &place in &grid.place {
        for (method, chosen) in methods.iter().enumerate() {
            let outputs: &[Option<usize>] =
                if chosen.method.scope == Scope::States { &[None] } else { &outputs };
            for input in 0..setting.inputs.len() {
                let slot = |&output| Slot { setting: number, place, input, output, method };
                slots.extend(outputs.iter().map(slot));
            }
        }
    }
    slots
}

impl Resolved {
    /// Every setting of every grid, in the order of the lists, the last list running fastest.
    pub(super) fn new(plan: &Plan) -> Result<Self> {
        let wrong = |detail: String| StudyError::Plan { plan: plan.name.clone(), detail };
        let (mut settings, mut methods) = (Vec::new(), Vec::new());
        for (number, grid) in plan.grids.iter().enumerate() {
            let chosen = grid
                .method
                .iter()
                .flat_map(|text| spelt_out(text))
                .map(|text| choose(&text))
                .collect::<Result<Vec<_>>>()?;
            let states = chosen.iter().any(|c| c.method.scope == Scope::States);
            for key in keys(grid) {
                fits(grid, &key, &chosen).map_err(wrong)?;
                for &max_delay in &grid.max_delay {
                    settings.push(Setting::new(plan, number, key.clone(), max_delay, states)?);
                }
            }
            methods.push(chosen);
        }
        let (mut slots, mut first) = (Vec::new(), vec![0]);
        for (number, setting) in settings.iter().enumerate() {
            let grid = &plan.grids[setting.grid];
            let of_grid = || settings.iter().filter(|s| s.grid == setting.grid);
            if let Some(unknown) =
                grid.output.iter().find(|o| !of_grid().any(|s| s.outputs.contains(o)))
            {
                let detail = format!("no plant of {} has an output `{unknown}`", grid.name);
                return Err(wrong(detail).into());
            }
            slots.extend(slots_of(number, setting, grid, &methods[setting.grid]));
            first.push(slots.len());
        }
        Ok(Self { settings, methods, slots, first })
    }

    /// The slots of one setting.
    pub(super) fn of(&self, setting: usize) -> std::ops::Range<usize> {
        self.first[setting]..self.first[setting + 1]
    }

    pub(super) fn chosen(&self, slot: Slot) -> &Chosen {
        &self.methods[self.settings[slot.setting].grid][slot.method]
    }
}

/// `NAME KEY=VALUE …`.
fn choose(text: &str) -> Result<Chosen> {
    let mut words = text.split_whitespace();
    let name = words.next().unwrap_or_default();
    let Some(method) = METHODS.iter().find(|m| m.entry.name == name) else {
        let known = METHODS.iter().map(|m| m.entry.name).collect();
        return Err(registry::RegistryError::Unknown {
            kind: "method",
            name: name.to_owned(),
            known,
        }
        .into());
    };
    let options = registry::options(words)?;
    Ok(Chosen { method, estimator: method.entry.with(options.clone())?, options })
}

/// Every combination of a grid's lists with separate records, the last list running fastest.
fn keys(grid: &Grid) -> Vec<Key> {
    fn expand<T: Clone>(keys: Vec<Key>, list: &[T], set: impl Fn(&mut Key, T)) -> Vec<Key> {
        let one = |key: &Key, value: &T| {
            let mut key = key.clone();
            set(&mut key, value.clone());
            key
        };
        keys.iter()
            .flat_map(|key| list.iter().map(|value| one(key, value)).collect::<Vec<_>>())
            .collect()
    }
    let blank = Key {
        plant: String::new(),
        c2d: String::new(),
        excitation: String::new(),
        snr: f64::INFINITY,
        noise: String::new(),
        loops: Loop::Open,
        controller: None,
        delay: Delay::Same(0.0),
        samples: 0,
        sample_time_s: 1.0,
        logging: PLAIN.to_owned(),
    };
    // An open loop has no controller to choose.
    let loops: Vec<(Loop, Option<String>)> = (grid.loops.iter())
        .flat_map(|&l| match l {
            Loop::Closed => grid.controller.iter().map(|c| (l, Some(c.clone()))).collect(),
            _ => vec![(l, None)],
        })
        .collect();
    let keys = expand(vec![blank], &grid.plant, |k, v| k.plant = v);
    let keys = expand(keys, &grid.c2d, |k, v| k.c2d = v);
    let keys = expand(keys, &grid.excitation, |k, v| k.excitation = v);
    let keys = expand(keys, &grid.snr, |k, v| k.snr = v);
    let keys = expand(keys, &grid.noise, |k, v| k.noise = v);
    let keys = expand(keys, &loops, |k, v| (k.loops, k.controller) = v);
    let keys = expand(keys, &grid.delay_s, |k, v| k.delay = v);
    let keys = expand(keys, &grid.samples, |k, v| k.samples = v);
    let keys = expand(keys, &grid.sample_time_s, |k, v| k.sample_time_s = v);
    expand(keys, &grid.logging, |k, v| k.logging = v)
}
