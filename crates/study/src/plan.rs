//! The content of a study: `deadtime/plan@1`, a TOML file whose keys are those of a cell, with lists.

#![deny(clippy::indexing_slicing)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};

use super::aim::Aim;
use super::error::{Result, StudyError};
use super::keys::{Delay, Loop, Place, Truth};
use super::logging::Logging;
use super::origin::Origin;
use super::published::{Published, spread};
use deadtime_delay::{Detrend, METHODS, Scope};
use deadtime_signal::file::read_text;
use deadtime_signal::text::located;

/// Plans of this folder, by name.
macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("plans/", $name, ".toml")))),*]
    };
}

/// The plans that ship with the program: name and text.
pub const PLANS: &[(&str, &str)] = shipped![
    "thesis",
    "thesis_delays",
    "unstable",
    "richness",
    "thresholding",
    "bjorklund",
    "twin",
    "subsample",
    "unrelated",
    "cost",
    "bounds",
    "ci"
];

const FORMAT: &str = "deadtime/plan@1";

/// A study to run: one or several products of lists.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Its name.
    pub name: String,
    /// Its purpose, in a sentence.
    #[serde(default)]
    pub about: String,
    /// Seed of every record, together with the content of the record.
    #[serde(default = "one")]
    pub seed: u64,
    /// Named excitations.
    #[serde(default)]
    pub excitations: BTreeMap<String, Signal>,
    /// Named noises.
    #[serde(default)]
    pub noises: BTreeMap<String, Colour>,
    /// Named controllers.
    #[serde(default)]
    pub controllers: BTreeMap<String, Controller>,
    /// Named ways of logging.
    #[serde(default)]
    pub loggings: BTreeMap<String, Logging>,
    /// The products.
    #[serde(skip_deserializing)]
    pub grids: Vec<Grid>,
    /// Published values, for comparison with the results.
    #[serde(default)]
    pub published: Vec<Published>,
    /// Numbers to be reached.
    #[serde(default)]
    pub aims: Vec<Aim>,
    /// The folder that file names of the plan count from.
    #[serde(skip)]
    pub folder: PathBuf,
    /// The text that it was read from, so that errors can tell the line.
    #[serde(skip)]
    pub origin: Origin,
}

/// An excitation of the registry with its options, under a name of the plan's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Signal {
    /// Its name in the registry.
    pub signal: String,
    /// Its options.
    #[serde(default)]
    pub options: serde_json::Map<String, serde_json::Value>,
    /// Whether every trial draws another one.
    #[serde(default)]
    pub draw: Draw,
}

/// When a random excitation is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Draw {
    /// For every trial.
    #[default]
    EachTrial,
    /// Once, and used for every trial.
    Once,
}

/// The colour of a noise, C(q)/A(q), coefficients from lag 1 on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Colour {
    /// a₁, a₂, … of A.
    pub ar: Vec<f64>,
    /// c₁, c₂, … of C.
    pub ma: Vec<f64>,
    /// Standard deviation of what goes into the filter, in the output's unit; absent: the plan's ratio `snr` sets the level.
    pub innovation_std: Option<f64>,
}

/// u = F(q)·(r − y), powers of q⁻¹ from 0 on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// b₀, b₁, …
    pub numerator: Vec<f64>,
    /// a₀, a₁, …; a₀ is not 0.
    pub denominator: Vec<f64>,
}

/// How answers are scored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scoring {
    /// Shares of all answers of a method, the worst left out, for which the root mean square is averaged over a grid's cells; percent.
    pub kept_percent: Vec<f64>,
    /// The score of a missing answer, samples (Björklund: 20). An answer, samples of response included, that is not above 0 and below this number has the same
    /// score. Absent: see `missing_off_samples`.
    pub invalid_samples: Option<f64>,
    /// The error of a missing answer, samples; absent: only answers are used.
    pub missing_off_samples: Option<f64>,
    /// An answer further off than this whose interval leaves out the truth is wrong without saying so; samples.
    pub wrong_samples: f64,
}

impl Default for Scoring {
    fn default() -> Self {
        Self {
            kept_percent: vec![100.0],
            invalid_samples: None,
            missing_off_samples: None,
            wrong_samples: 1.0,
        }
    }
}

/// One product of lists. Every combination of the first group is a setting, of which `trials` records are made; all methods see the same records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Grid {
    /// Its name.
    #[serde(rename(deserialize = "grid"))]
    pub name: String,
    /// Plants by name, or model files.
    #[serde(deserialize_with = "list")]
    pub plant: Vec<String>,
    /// Conversions to sampled time; `NAME KEY=VALUE …` sets options.
    #[serde(deserialize_with = "list")]
    pub c2d: Vec<String>,
    /// Excitations by the plan's name or the registry's.
    #[serde(deserialize_with = "list")]
    pub excitation: Vec<String>,
    /// var(noise-free output)/var(noise); infinite: no noise.
    #[serde(deserialize_with = "ratios")]
    pub snr: Vec<f64>,
    /// `white`, or a noise of the plan's.
    #[serde(deserialize_with = "list")]
    pub noise: Vec<String>,
    /// Loops.
    #[serde(rename = "loop", deserialize_with = "list")]
    pub loops: Vec<Loop>,
    /// With closed loops: controllers of the plan's, or `dlqr`.
    #[serde(deserialize_with = "list")]
    pub controller: Vec<String>,
    /// Injected delays.
    pub delay_s: Vec<Delay>,
    /// Samples of a record.
    #[serde(deserialize_with = "list")]
    pub samples: Vec<usize>,
    /// Sample times, s.
    #[serde(deserialize_with = "list")]
    pub sample_time_s: Vec<f64>,
    /// Longest raw delays searched, samples.
    #[serde(deserialize_with = "list")]
    pub max_delay: Vec<usize>,
    /// `plain`, or a way of logging of the plan's.
    #[serde(deserialize_with = "list")]
    pub logging: Vec<String>,
    /// Where the delay is estimated from.
    #[serde(deserialize_with = "list")]
    pub place: Vec<Place>,
    /// Outputs; empty: all of the plant.
    #[serde(deserialize_with = "list")]
    pub output: Vec<String>,
    /// Methods, `NAME KEY=VALUE …`; `all`: every method of pairs; `all_events`: every method of events.
    #[serde(deserialize_with = "list")]
    pub method: Vec<String>,
    /// The reference of the answers.
    pub truth: Truth,
    /// How answers are scored.
    pub scoring: Scoring,
    /// Records of a setting.
    pub trials: usize,
    /// The trend that is removed from the channels.
    pub detrend: Detrend,
    /// Samples of response that methods subtract: those of the plant (`true`), or the one that is assumed without a model.
    pub known_degree: bool,
    /// Tables in addition to the list of all cells.
    pub by: Vec<Layout>,
}

/// The defaults of a grid.
impl Default for Grid {
    fn default() -> Self {
        let one = |name: &str| vec![name.to_owned()];
        Self {
            name: String::new(),
            plant: Vec::new(),
            c2d: one("zoh"),
            excitation: Vec::new(),
            snr: vec![f64::INFINITY],
            noise: one("white"),
            loops: vec![Loop::Open],
            controller: one("dlqr"),
            delay_s: vec![Delay::Same(0.0)],
            samples: vec![500],
            sample_time_s: vec![1.0],
            max_delay: vec![35],
            logging: one(PLAIN),
            place: vec![Place::U],
            output: Vec::new(),
            method: Vec::new(),
            truth: Truth::Delay,
            scoring: Scoring::default(),
            trials: TRIALS,
            detrend: Detrend::default(),
            known_degree: true,
            by: Vec::new(),
        }
    }
}

/// A table of one statistic, `KEY …` or `STATISTIC: KEY …`. The values of the last key are columns, those of the others and the methods are rows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String")]
pub struct Layout {
    /// The displayed statistic.
    pub shown: Shown,
    /// Keys of cells, one at least.
    pub keys: Vec<String>,
}

/// The statistic of a [`Layout`] over the cells that share a place in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shown {
    /// Mean of their root mean square errors, and the share of records without an answer.
    Rms,
    /// Share of their records with an answer that is wrong without saying so (see [`Scoring`]).
    Wrong,
    /// Mean of their biases.
    Bias,
    /// The growth of the mean answer with the injected delay: 1 where a method follows it, 0 where it is a constant.
    Slope,
    /// Median of their Cramér-Rao bounds.
    Bound,
    /// Mean of their root mean square errors over the median of their Cramér-Rao bounds.
    OverBound,
    /// Median of the standard deviations that [`deadtime_delay::richness`] predicts before estimating.
    Predicted,
}

impl TryFrom<String> for Layout {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let (shown, keys) = match text.split_once(':') {
            None => (Shown::Rms, text.as_str()),
            Some((name, keys)) => {
                let shown = serde_json::from_value(name.trim().into());
                (shown.map_err(|_| format!("`by` shows `{name}`: there are rms, wrong, bias, slope, bound, over_bound, predicted"))?, keys)
            }
        };
        let keys: Vec<String> = keys.split_whitespace().map(str::to_owned).collect();
        match keys.iter().find(|k| !BY.contains(&k.as_str())) {
            Some(key) => Err(format!("`by` names `{key}`: there are {}", BY.join(", "))),
            None if keys.is_empty() => Err("`by` names no key".to_owned()),
            None => Ok(Self { shown, keys }),
        }
    }
}

/// A list, or one value for a list of one.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum Many<T> {
    One(T),
    All(Vec<T>),
}

impl<T> From<Many<T>> for Vec<T> {
    fn from(many: Many<T>) -> Self {
        match many {
            Many::One(one) => vec![one],
            Many::All(all) => all,
        }
    }
}

fn list<'de, D: Deserializer<'de>, T: Deserialize<'de>>(keys: D) -> Result<Vec<T>, D::Error> {
    Many::deserialize(keys).map(Vec::from)
}

/// A ratio of variances: a number, or `"inf"` for no noise.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum Ratio {
    Number(f64),
    Text(String),
}

fn ratios<'de, D: Deserializer<'de>>(keys: D) -> Result<Vec<f64>, D::Error> {
    let wrong = |value: &dyn std::fmt::Display| {
        D::Error::custom(format!("`snr` is {value}: give numbers above 0, or \"inf\" for no noise"))
    };
    let ratio = |ratio| match ratio {
        Ratio::Number(v) if v > 0.0 => Ok(v),
        Ratio::Text(t) if t == "inf" => Ok(f64::INFINITY),
        Ratio::Number(v) => Err(wrong(&v)),
        Ratio::Text(t) => Err(wrong(&format!("\"{t}\""))),
    };
    list(keys)?.into_iter().map(ratio).collect()
}

fn one() -> u64 {
    1
}

/// Keys of the head; every other key of the file is one of a cell.
const HEAD: [&str; 10] = [
    "format",
    "name",
    "about",
    "seed",
    "excitations",
    "noises",
    "controllers",
    "loggings",
    "published",
    "aims",
];
/// Keys of cells that tables can be laid out by.
const BY: [&str; 11] = [
    "plant",
    "output",
    "c2d",
    "excitation",
    "snr",
    "noise",
    "loop",
    "delay_s",
    "samples",
    "logging",
    "place",
];
/// The logging that lacks nothing.
pub(super) const PLAIN: &str = "plain";
/// Records of a setting where a plan has no number.
const TRIALS: usize = 100;

impl Plan {
    /// A shipped plan by its name, or a file.
    ///
    /// # Errors
    /// [`StudyError::UnknownPlan`], [`StudyError::Plan`] naming the key, [`FileError::Io`](deadtime_signal::file::FileError::Io).
    pub fn open(name: &str) -> Result<Self> {
        if let Some((name, text)) = PLANS.iter().find(|(n, _)| *n == name) {
            return Ok(Self::parse(name, text, Path::new("."))?);
        }
        let path = Path::new(name);
        if !path.exists() {
            return Err(StudyError::UnknownPlan {
                name: name.to_owned(),
                known: PLANS.iter().map(|p| p.0).collect(),
            }
            .into());
        }
        let text = read_text(path)?;
        Ok(Self::parse(name, &text, path.parent().unwrap_or(Path::new(".")))?)
    }

    /// A plan from its text; file names in it count from `folder`.
    ///
    /// # Errors
    /// [`StudyError::Plan`] naming the file, the line and the key.
    pub fn parse(name: &str, text: &str, folder: &Path) -> Result<Self, StudyError> {
        let wrong = |e: toml::de::Error| StudyError::Plan {
            plan: name.to_owned(),
            detail: located(text, e.span().map(|s| s.start), e.message()),
        };
        let keys = toml::from_str(text).map_err(wrong)?;
        let origin = Origin::of(name, text);
        let plan = Self::of(name, keys, folder).map_err(|e| origin.study(e))?;
        Ok(Self { origin, ..plan })
    }

    /// A plan from its keys, as a file has them.
    ///
    /// # Errors
    /// [`StudyError::Plan`] naming the key.
    pub fn of(name: &str, mut keys: toml::Table, folder: &Path) -> Result<Self, StudyError> {
        let wrong = |detail: String| StudyError::Plan { plan: name.to_owned(), detail };
        let grids = match keys.remove("grids") {
            None => vec![toml::Table::new()],
            Some(toml::Value::Array(list)) => list
                .into_iter()
                .map(|g| match g {
                    toml::Value::Table(t) => Ok(t),
                    _ => Err(wrong("`grids` holds tables: write [[grids]]".to_owned())),
                })
                .collect::<Result<_, _>>()?,
            Some(_) => {
                return Err(wrong("`grids` is a list of tables: write [[grids]]".to_owned()));
            }
        };
        if let Some(entries) = keys.remove("published") {
            keys.insert("published".to_owned(), spread(entries).map_err(&wrong)?);
        }
        let (mut head, shared): (toml::Table, toml::Table) =
            keys.into_iter().partition(|(k, _)| HEAD.contains(&k.as_str()));
        let Some(format) = head.remove("format") else {
            return Err(wrong("missing field `format`".to_owned()));
        };
        if format.as_str() != Some(FORMAT) {
            let found = format.as_str().map_or_else(|| format.to_string(), str::to_owned);
            return Err(wrong(format!("format is `{found}`; this program reads `{FORMAT}`")));
        }
        let mut plan: Self = read(head).map_err(&wrong)?;
        let many = grids.len() > 1;
        for (number, own) in grids.into_iter().enumerate() {
            let mut all = shared.clone();
            all.extend(own);
            let label = format!("grid {}", number + 1);
            let mut grid: Grid = read(all).map_err(|e| wrong(format!("{label}: {e}")))?;
            if grid.name.is_empty() {
                grid.name = if many { label.clone() } else { plan.name.clone() };
            }
            grid.check().map_err(|e| wrong(format!("{label}: {e}")))?;
            if plan.grids.iter().any(|before| before.name == grid.name) {
                return Err(wrong(format!(
                    "two grids are called `{}`: give each its own name with the key `grid`",
                    grid.name
                )));
            }
            plan.grids.push(grid);
        }
        plan.folder = folder.to_owned();
        plan.check().map_err(wrong)?;
        Ok(plan)
    }

    /// The plan as the text of a file that reads as this very plan.
    ///
    /// # Errors
    /// [`StudyError::Plan`] for a seed that no file can hold.
    pub fn to_toml(&self) -> Result<String, StudyError> {
        let wrong = |detail: String| StudyError::Plan { plan: self.name.clone(), detail };
        let grids = self
            .grids
            .iter()
            .map(Grid::keys)
            .collect::<Result<Vec<_>, _>>()
            .map_err(|e| wrong(e.to_string()))?;
        let mut keys = toml::Table::new();
        let mut put =
            |key: &str, value: Result<toml::Value, toml::ser::Error>| -> Result<(), StudyError> {
                let value = value.map_err(|e| wrong(format!("{key}: {e}")))?;
                let blank = value.as_array().is_some_and(Vec::is_empty)
                    || value.as_table().is_some_and(toml::Table::is_empty);
                if !blank {
                    keys.insert(key.to_owned(), value);
                }
                Ok(())
            };
        put("format", Ok(FORMAT.into()))?;
        put("name", Ok(self.name.as_str().into()))?;
        put("about", Ok(self.about.as_str().into()))?;
        put("seed", toml::Value::try_from(self.seed))?;
        put("excitations", toml::Value::try_from(&self.excitations))?;
        put("noises", toml::Value::try_from(&self.noises))?;
        put("controllers", toml::Value::try_from(&self.controllers))?;
        put("loggings", toml::Value::try_from(&self.loggings))?;
        put("grids", Ok(toml::Value::Array(grids)))?;
        put("published", toml::Value::try_from(&self.published))?;
        put("aims", toml::Value::try_from(&self.aims))?;
        toml::to_string(&keys).map_err(|e| wrong(e.to_string()))
    }

    /// Leaves out all grids and methods but these; an empty list leaves out none. A method is named with the options that the plan gives it, or without: then with any.
    ///
    /// # Errors
    /// [`StudyError::Plan`] for one that the plan does not have, with those that it has.
    pub fn only(&mut self, grids: &[String], methods: &[String]) -> Result<(), StudyError> {
        let wrong = |what: &str, name: &str, mut known: Vec<String>| {
            let mut seen = BTreeSet::new();
            known.retain(|k| seen.insert(k.clone()));
            let detail =
                format!("there is no {what} `{name}` in it; there are: {}", known.join(", "));
            StudyError::Plan { plan: self.name.clone(), detail }
        };
        let fits = |wanted: &str, method: &str| {
            wanted == method || Some(wanted) == method.split_whitespace().next()
        };
        if let Some(unknown) =
            grids.iter().find(|g| !self.grids.iter().any(|grid| grid.name == **g))
        {
            return Err(wrong(
                "grid",
                unknown,
                self.grids.iter().map(|g| g.name.clone()).collect(),
            ));
        }
        let mut left: Vec<Grid> = self
            .grids
            .iter()
            .filter(|g| grids.is_empty() || grids.contains(&g.name))
            .cloned()
            .collect();
        if !methods.is_empty() {
            left.iter_mut()
                .for_each(|g| g.method = g.method.iter().flat_map(|m| spelt_out(m)).collect());
            if let Some(unknown) =
                methods.iter().find(|m| !left.iter().flat_map(|g| &g.method).any(|of| fits(m, of)))
            {
                return Err(wrong(
                    "method",
                    unknown,
                    left.into_iter().flat_map(|g| g.method).collect(),
                ));
            }
            left.iter_mut().for_each(|g| g.method.retain(|of| methods.iter().any(|m| fits(m, of))));
            left.retain(|g| !g.method.is_empty());
        }
        self.grids = left;
        Ok(())
    }

    /// Numbers that cannot be; names are looked up where they are used, and settings are tried, before anything runs.
    fn check(&self) -> Result<(), String> {
        if let Some(aim) = self.aims.iter().find(|a| a.at_most.is_none() && a.at_least.is_none()) {
            return Err(format!("aims: `{}` has no limit: give at_most or at_least", aim.aim));
        }
        for (name, controller) in &self.controllers {
            let coefficients = controller.numerator.iter().chain(&controller.denominator);
            if controller.numerator.is_empty()
                || controller.denominator.first().is_none_or(|a| *a == 0.0)
                || !coefficients.clone().all(|c| c.is_finite())
            {
                return Err(format!(
                    "controllers.{name}: give finite coefficients, the first of the denominator not 0"
                ));
            }
        }
        for (name, noise) in &self.noises {
            if name == "white" || noise.innovation_std.is_some_and(|s| !(s.is_finite() && s >= 0.0))
            {
                return Err(format!(
                    "noises.{name}: `white` is taken, and innovation_std is 0 or more"
                ));
            }
        }
        for (name, logging) in &self.loggings {
            if name == PLAIN {
                return Err(format!("loggings.{name}: that name is taken, by what lacks nothing"));
            }
            logging.check().map_err(|e| format!("loggings.{name}: {e}"))?;
        }
        Ok(())
    }
}

/// The meaning of the words `all` and `all_events`.
fn all_of(method: &str) -> Option<Scope> {
    match method {
        "all" => Some(Scope::Pair),
        "all_events" => Some(Scope::Events),
        _ => None,
    }
}

/// `all` expanded to its names.
pub(super) fn spelt_out(method: &str) -> Vec<String> {
    match all_of(method) {
        Some(scope) => {
            METHODS.iter().filter(|m| m.scope == scope).map(|m| m.entry.name.to_owned()).collect()
        }
        None => vec![method.to_owned()],
    }
}

/// The number of names of a method.
pub(super) fn spelt(method: &str) -> usize {
    all_of(method).map_or(1, |scope| METHODS.iter().filter(|m| m.scope == scope).count())
}

fn read<T: DeserializeOwned>(table: toml::Table) -> Result<T, String> {
    toml::Value::Table(table).try_into().map_err(|e: toml::de::Error| e.message().to_owned())
}

impl Grid {
    /// The keys of a file that make this grid.
    fn keys(&self) -> Result<toml::Value, toml::ser::Error> {
        let mut value =
            toml::Value::try_from(Self { snr: Vec::new(), by: Vec::new(), ..self.clone() })?;
        if let Some(keys) = value.as_table_mut() {
            keys.remove("name");
            keys.insert("grid".to_owned(), self.name.as_str().into());
            let ratio = |r: &f64| if r.is_finite() { toml::Value::from(*r) } else { "inf".into() };
            keys.insert("snr".to_owned(), toml::Value::Array(self.snr.iter().map(ratio).collect()));
            let layout = |l: &Layout| {
                Ok(format!(
                    "{}: {}",
                    toml::Value::try_from(l.shown)?.as_str().unwrap_or_default(),
                    l.keys.join(" ")
                )
                .into())
            };
            keys.insert(
                "by".to_owned(),
                toml::Value::Array(
                    self.by.iter().map(layout).collect::<Result<_, toml::ser::Error>>()?,
                ),
            );
        }
        Ok(value)
    }

    /// Compulsory keys are present, and numbers are possible.
    fn check(&self) -> Result<(), String> {
        for (key, list, hint) in [
            ("plant", &self.plant, "name plants (`deadtime list plants`) or model files"),
            (
                "excitation",
                &self.excitation,
                "name excitations (`deadtime list excitations`) or those of [excitations]",
            ),
            ("method", &self.method, "name methods (`deadtime list methods`), or `all`"),
        ] {
            if list.is_empty() {
                return Err(format!("`{key}` is missing: {hint}"));
            }
        }
        if let Some(delay) = self.delay_s.iter().find(|delay| !delay.can_be()) {
            return Err(format!(
                "`delay_s` holds {delay}: give seconds, 0 or more, or {{ uniform_s = [FROM, TO] }}"
            ));
        }
        if self.trials == 0 || self.samples.contains(&0) || self.max_delay.contains(&0) {
            return Err("`trials`, `samples` and `max_delay` are 1 or more".to_owned());
        }
        if self.place.contains(&Place::R) && self.loops.iter().any(|l| *l != Loop::Closed) {
            return Err("`place` r: only a closed loop has a reference besides u".to_owned());
        }
        self.scoring.check()
    }
}

impl Scoring {
    fn check(&self) -> Result<(), String> {
        let Self { kept_percent, invalid_samples, missing_off_samples, wrong_samples } = self;
        if kept_percent.is_empty() || kept_percent.iter().any(|k| !(*k > 0.0 && *k <= 100.0)) {
            return Err("scoring.kept_percent: give numbers above 0 and up to 100".to_owned());
        }
        let beyond = |v: &f64| !(v.is_finite() && *v > 0.0);
        if [invalid_samples, missing_off_samples].into_iter().flatten().any(beyond)
            || !(wrong_samples.is_finite() && *wrong_samples >= 0.0)
        {
            return Err("scoring: invalid_samples and missing_off_samples are above 0, wrong_samples 0 or more".to_owned());
        }
        if invalid_samples.is_some() && missing_off_samples.is_some() {
            return Err("scoring: invalid_samples says already what a missing answer counts; leave out missing_off_samples".to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_plan_reads_as_itself_from_the_text_that_it_writes() {
        for (name, _) in PLANS {
            let plan = Plan::open(name).unwrap();
            let again = Plan::parse(name, &plan.to_toml().unwrap(), &plan.folder).unwrap();
            assert_eq!(again, plan, "{name}");
        }
        let mut plan = Plan::open("bjorklund").unwrap();
        plan.only(&[], &["arxstruc".to_owned()]).unwrap();
        plan.seed = 1 << 53;
        assert_eq!(Plan::parse("", &plan.to_toml().unwrap(), &plan.folder).unwrap(), plan);
    }
}
