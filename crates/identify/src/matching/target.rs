//! The identified model, as the target of a match, with the uncertainty from its file.

use std::path::Path;

use nalgebra::DMatrix;
use serde::Deserialize;

use super::error::MatchingError;
use super::system::System;
use crate::error::Result;
use deadtime_model::{Channel, ModelDocument, ModelError, ModelFile, Operating, StateSpace};
use deadtime_signal::time::SampleTime;

/// An identified model.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// The name of the model.
    pub name: String,
    /// The inputs, with the operating point.
    pub inputs: Vec<Channel>,
    /// The outputs.
    pub outputs: Vec<Channel>,
    pub(super) system: System,
    /// Independent deviations of one standard deviation each.
    pub(super) deviations: Vec<System>,
    /// The lowest frequency that the data determine, rad/s.
    pub(super) lowest_rad_s: Option<f64>,
}

/// The part of `deadtime/identify@1` that a match needs.
#[derive(Deserialize)]
struct Data {
    sample_time_s: f64,
    rows: usize,
    inputs: Vec<Named>,
    outputs: Vec<Named>,
    input_delay_s: Vec<f64>,
    model: Model,
}

#[derive(Deserialize)]
struct Named {
    name: String,
    unit: Option<String>,
}

#[derive(Deserialize)]
struct Model {
    #[serde(rename = "A")]
    a: Vec<Vec<f64>>,
    #[serde(rename = "B")]
    b: Vec<Vec<f64>>,
    #[serde(rename = "C")]
    c: Vec<Vec<f64>>,
    #[serde(rename = "D")]
    d: Vec<Vec<f64>>,
    operating: Point,
    #[serde(default)]
    deviations: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Point {
    inputs: Vec<f64>,
    outputs: Vec<f64>,
}

/// Step of the deviations, small enough that their effect on the response is a derivative.
const STEP: f64 = 1e-3;

impl Target {
    /// Reads a linear model file, or the output of `deadtime identify --json`, which includes the uncertainty.
    ///
    /// # Errors
    /// [`FileError::Io`](deadtime_signal::file::FileError::Io), [`ModelError`], or [`MatchingError::NotIdentified`] for another kind of file.
    pub fn read(path: &Path) -> Result<Self> {
        if path.extension().is_some_and(|e| e == "json") {
            let text = deadtime_signal::file::read_text(path)?;
            let format = serde_json::from_str::<serde_json::Value>(&text)
                .ok()
                .and_then(|v| Some(v.get("format")?.as_str()?.to_owned()));
            if format.as_deref() == Some("deadtime/identify@1") {
                return Self::from_identify(&text, path);
            }
        }
        match ModelDocument::read(path)? {
            ModelDocument::Lti(file) => Self::from_file(&file),
            ModelDocument::Equations(_) => {
                let found = "a model of kind \"equations\"".to_owned();
                Err(MatchingError::NotIdentified { path: path.to_owned(), found }.into())
            }
        }
    }

    /// From the text of `deadtime/identify@1`; `source` is its name.
    ///
    /// # Errors
    /// [`MatchingError::NotIdentified`] for another text.
    pub fn from_identify(text: &str, source: &Path) -> Result<Self> {
        let not = |found: String| MatchingError::NotIdentified { path: source.to_owned(), found };
        let data: Data = serde_json::from_str(text)
            .map_err(|e| not(format!("a file of deadtime/identify@1 in which {e}")))?;
        let name =
            source.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        Self::from_data(name, data, &not)
    }

    /// From a linear model file, without uncertainty.
    ///
    /// # Errors
    /// [`ModelError`], or [`MatchingError::Unsupported`] for a model with effects.
    pub fn from_file(file: &ModelFile) -> Result<Self> {
        if !file.effects.is_empty() {
            let (model, remedy) = (file.name.clone(), "take them out");
            return Err(MatchingError::Unsupported { model, what: "effects", remedy }.into());
        }
        let system = if file.is_sampled() {
            System::Sampled(file.sampled()?)
        } else {
            System::Continuous(file.continuous()?)
        };
        let (inputs, outputs) = (file.inputs.clone(), file.outputs.clone());
        Ok(Self {
            name: file.name.clone(),
            inputs,
            outputs,
            system,
            deviations: Vec::new(),
            lowest_rad_s: None,
        })
    }

    /// From an identified model with its uncertainty, behind these input delays (samples).
    ///
    /// # Errors
    /// [`ModelError::Count`] for another number of delays.
    pub fn from_identified(
        name: &str,
        found: &crate::subspace::identifier::Identified,
        delays: &[usize],
    ) -> Result<Self> {
        let file = found.file(name, delays, false)?;
        let mut target = Self::from_file(&file)?;
        target.with_uncertainty(&found.deviations(), found.rows)?;
        Ok(target)
    }

    fn from_data(name: String, data: Data, not: &dyn Fn(String) -> MatchingError) -> Result<Self> {
        let wrong = |what: &str| not(format!("a file of deadtime/identify@1 in which {what}"));
        let channels = |named: Vec<Named>, means: Vec<f64>| -> Option<Vec<Channel>> {
            let channel = |(n, mean): (Named, f64)| Channel {
                operating: Operating::Value(mean),
                ..Channel::plain(&n.name, n.unit.as_deref())
            };
            (named.len() == means.len())
                .then(|| named.into_iter().zip(means).map(channel).collect())
        };
        let inputs = channels(data.inputs, data.model.operating.inputs)
            .ok_or_else(|| wrong("inputs and their means differ in number"))?;
        let outputs = channels(data.outputs, data.model.operating.outputs)
            .ok_or_else(|| wrong("outputs and their means differ in number"))?;
        let n = data.model.a.len();
        let matrix = |rows: &[Vec<f64>], columns: usize| {
            let fits = rows.iter().all(|r| r.len() == columns);
            fits.then(|| {
                DMatrix::from_row_iterator(rows.len(), columns, rows.iter().flatten().copied())
            })
            .ok_or_else(|| wrong("the rows of a matrix differ in length"))
        };
        let ts = SampleTime::new(data.sample_time_s)?;
        let (a, b) = (matrix(&data.model.a, n)?, matrix(&data.model.b, inputs.len())?);
        let (c, d) = (matrix(&data.model.c, n)?, matrix(&data.model.d, inputs.len())?);
        let delays = data
            .input_delay_s
            .iter()
            .map(|&s| Ok(ts.samples(s)?.whole))
            .collect::<std::result::Result<Vec<usize>, ModelError>>()?;
        let system =
            System::Sampled(StateSpace::sampled(a, b, c, d, ts)?.with_input_delay(delays)?);
        let mut target =
            Self { name, inputs, outputs, system, deviations: Vec::new(), lowest_rad_s: None };
        target.with_uncertainty(&data.model.deviations, data.rows)?;
        Ok(target)
    }

    /// The lowest frequency has two periods within the rows.
    fn with_uncertainty(&mut self, deviations: &[Vec<f64>], rows: usize) -> Result<()> {
        if let System::Sampled(sys) = &self.system {
            self.lowest_rad_s = Some(
                2.0 * std::f64::consts::TAU / (rows.max(8) as f64 * sys.sample_time().seconds()),
            );
        }
        self.deviations = deviations
            .iter()
            .map(|d| self.system.moved(d, STEP))
            .collect::<std::result::Result<_, ModelError>>()?;
        Ok(())
    }

    /// The file has an uncertainty.
    #[must_use]
    pub fn has_uncertainty(&self) -> bool {
        !self.deviations.is_empty()
    }

    /// The effect of a deviation of one standard deviation: the slope between the response and that of the slightly moved model.
    pub(super) fn slope(
        response: &DMatrix<nalgebra::Complex<f64>>,
        moved: &DMatrix<nalgebra::Complex<f64>>,
    ) -> DMatrix<nalgebra::Complex<f64>> {
        (moved - response) / nalgebra::Complex::new(STEP, 0.0)
    }
}
