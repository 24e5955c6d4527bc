//! Model files of transfer functions, `kind = "tf"` (polynomials) and `kind = "zpk"` (zeros, poles, gain); read as linear models.

use std::path::Path;

use nalgebra::{Complex, DMatrix};
use serde::Deserialize;

use super::channel::{Channel, EffectEntry};
use super::check::check_sample_time;
use super::lti::{ModelFile, State};
use super::nuisance::NuisanceEntry;
use super::text::{Syntax, parse_text};
use crate::error::ModelError;
use crate::state_space::{Continuous, Sampled, StateSpace, TimeDomain};
use crate::transfer_function::TransferFunction;
use deadtime_signal::time::SampleTime;

/// The keys of such a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TransferFile {
    #[serde(rename = "format")]
    _format: String,
    name: String,
    kind: String,
    #[serde(default)]
    sample_time_s: f64,
    inputs: Vec<Channel>,
    outputs: Vec<Channel>,
    #[serde(default)]
    input_delay_s: Vec<f64>,
    /// One for each pair that is not zero.
    transfer: Vec<Transfer>,
    /// Refused: the states have no meaning that a file could know.
    initial: Option<serde::de::IgnoredAny>,
    initial_std: Option<serde::de::IgnoredAny>,
    #[serde(default)]
    effects: Vec<EffectEntry>,
    #[serde(default)]
    nuisances: Vec<NuisanceEntry>,
}

/// From one input to one output; names are optional where there is only one.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Transfer {
    input: Option<String>,
    output: Option<String>,
    /// Highest power first.
    numerator: Option<Vec<f64>>,
    /// Highest power first.
    denominator: Option<Vec<f64>>,
    #[serde(default)]
    zeros: Vec<Root>,
    poles: Option<Vec<Root>>,
    gain: Option<f64>,
}

/// A real number, or `[re, im]`.
#[derive(Deserialize, Clone, Copy)]
#[serde(untagged)]
enum Root {
    Real(f64),
    Complex([f64; 2]),
}

impl Root {
    fn number(self) -> Complex<f64> {
        match self {
            Self::Real(re) => Complex::new(re, 0.0),
            Self::Complex([re, im]) => Complex::new(re, im),
        }
    }
}

/// The file as a linear model: the concatenated states of every transfer function.
pub(super) fn parse(text: &str, syntax: Syntax, path: &Path) -> Result<ModelFile, ModelError> {
    let file: TransferFile = parse_text(text, syntax, path)?;
    let wrong = |detail: String| ModelError::File { path: path.to_owned(), detail };
    check_sample_time(path, file.sample_time_s)?;
    if file.initial.is_some() || file.initial_std.is_some() {
        return Err(wrong(
            "a transfer function has no initial state in its file: its states have no physical meaning, and every log's is estimated; give a known one as `kind = \"lti\"` or as equations".to_owned(),
        ));
    }
    let matrices = if file.sample_time_s > 0.0 {
        let ts = SampleTime::new(file.sample_time_s)?;
        file.assembled(Sampled(ts), &wrong)?
    } else {
        file.assembled(Continuous, &wrong)?
    };
    let states: Vec<State> =
        (1..=matrices[0].nrows()).map(|i| State { name: format!("x{i}"), unit: None }).collect();
    let [a, b, c, d] = &matrices;
    let mut model = ModelFile::from_matrices(
        &file.name,
        file.sample_time_s,
        [a, b, c, d],
        file.input_delay_s,
        (file.inputs, states, file.outputs),
    )?;
    model.effects = file.effects;
    model.nuisances = file.nuisances;
    model.check(path)?;
    Ok(model)
}

impl TransferFile {
    fn assembled<T: TimeDomain>(
        &self,
        domain: T,
        wrong: &dyn Fn(String) -> ModelError,
    ) -> Result<[DMatrix<f64>; 4], ModelError> {
        let place = |what: &str, name: &Option<String>, channels: &[Channel]| match name {
            Some(name) => channels.iter().position(|c| c.name == *name).ok_or_else(|| {
                let known: Vec<&str> = channels.iter().map(|c| c.name.as_str()).collect();
                wrong(format!(
                    "[[transfer]]: there is no {what} `{name}`; there are: {}",
                    known.join(", ")
                ))
            }),
            None if channels.len() == 1 => Ok(0),
            None => Err(wrong(format!(
                "[[transfer]]: say which {what} it is for, as {what} = \"NAME\""
            ))),
        };
        let mut parts: Vec<(usize, usize, StateSpace<T>)> = Vec::new();
        for transfer in &self.transfer {
            let (i, j) = (
                place("output", &transfer.output, &self.outputs)?,
                place("input", &transfer.input, &self.inputs)?,
            );
            let of = |channels: &[Channel], at: usize| {
                channels.get(at).map_or_else(String::new, |c| c.name.clone())
            };
            let named = |detail: String| {
                wrong(format!("from {} to {}: {detail}", of(&self.inputs, j), of(&self.outputs, i)))
            };
            if parts.iter().any(|(row, column, _)| (*row, *column) == (i, j)) {
                return Err(named("two [[transfer]] entries; add them up into one".to_owned()));
            }
            let system = transfer
                .function(&self.kind, domain, &named)?
                .to_state_space()
                .map_err(|e| named(e.to_string()))?;
            parts.push((i, j, system));
        }
        let n = parts.iter().map(|p| p.2.order()).sum();
        let (m, l) = (self.inputs.len(), self.outputs.len());
        let (mut a, mut b) = (DMatrix::zeros(n, n), DMatrix::zeros(n, m));
        let (mut c, mut d) = (DMatrix::zeros(l, n), DMatrix::zeros(l, m));
        let mut at = 0;
        for (i, j, part) in &parts {
            let own = part.order();
            a.view_mut((at, at), (own, own)).copy_from(part.a());
            b.view_mut((at, *j), (own, 1)).copy_from(part.b());
            c.view_mut((*i, at), (1, own)).copy_from(part.c());
            d.view_mut((*i, *j), (1, 1)).copy_from(part.d());
            at += own;
        }
        Ok([a, b, c, d])
    }
}

impl Transfer {
    fn function<T: TimeDomain>(
        &self,
        kind: &str,
        domain: T,
        named: &dyn Fn(String) -> ModelError,
    ) -> Result<TransferFunction<T>, ModelError> {
        let none = T::Delay::default();
        let made = match (kind, &self.numerator, &self.denominator, &self.poles, self.gain) {
            ("tf", Some(numerator), Some(denominator), None, None) if self.zeros.is_empty() => {
                TransferFunction::from_polynomials(numerator, denominator, none, domain)
            }
            ("zpk", None, None, Some(poles), Some(gain)) => {
                let numbers = |roots: &[Root]| roots.iter().map(|r| r.number()).collect();
                TransferFunction::from_zeros_poles_gain(
                    numbers(&self.zeros),
                    numbers(poles),
                    gain,
                    none,
                    domain,
                )
            }
            ("tf", ..) => return Err(named(
                "kind `tf` takes numerator and denominator, highest power first, and nothing else"
                    .to_owned(),
            )),
            _ => {
                return Err(named(
                    "kind `zpk` takes zeros, poles and gain, and nothing else".to_owned(),
                ));
            }
        };
        made.map_err(|e| named(e.to_string()))
    }
}
