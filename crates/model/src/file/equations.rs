//! The model file of a nonlinear model, `kind = "equations"`.

use std::path::Path;

use serde::{Deserialize, Serialize, Serializer};

use super::candidate::{CandidateEntry, Candidates};
use super::channel::{Channel, ChannelKind, EffectEntry, Operating};
use super::check::{Sign, check_channels, check_list, check_sizes, number, unmatched};
use super::nuisance::{NuisanceEntry, check_nuisances};
use super::table::{self, Table};
use super::text::{FORMAT, Syntax, parse_text, read_text, syntax, write_text};
use crate::equations::error::EquationError;
use crate::equations::system::{
    Definition, Equations, OutputVariable, Parameter, StateVariable, Symbol,
};
use crate::error::{ModelError, Result};

/// A state's unit and initial value.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateEntry {
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The value at the start of a log.
    #[serde(default)]
    pub initial: f64,
    /// Standard deviation of `initial`, 0: exact; `None`: unknown initial state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_std: Option<f64>,
}

/// A parameter's unit and value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterEntry {
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Its value.
    pub value: f64,
    /// The value is exact (kinematics, gravity): it is no candidate cause of a gap, and a fit of `all` parameters keeps it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub known: bool,
}

impl ParameterEntry {
    /// A parameter that a fit may change.
    #[must_use]
    pub fn new(unit: Option<String>, value: f64) -> Self {
        Self { unit, value, known: false }
    }
}

/// The joint meaning of the outputs of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GroupKind {
    /// A vector: its error is the length of the difference.
    #[default]
    Vector,
    /// A unit quaternion, scalar last: its error is the angle of the rotation between the two.
    Attitude,
}

/// Outputs with a common error measure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroupEntry {
    /// The outputs' names.
    pub outputs: Vec<String>,
    /// Their joint meaning.
    #[serde(default)]
    pub kind: GroupKind,
}

/// A nonlinear model as in its file. The tables keep the file's order; that of `states` is the order of the states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EquationsFile {
    pub(super) format: String,
    /// The model's name.
    pub name: String,
    pub(super) kind: String,
    #[serde(default, skip_serializing)]
    pub(super) sample_time_s: f64,
    /// The inputs.
    #[serde(serialize_with = "without_operating")]
    pub inputs: Vec<Channel>,
    /// The outputs.
    #[serde(serialize_with = "without_operating")]
    pub outputs: Vec<Channel>,
    /// One delay per input, s; empty: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub input_delay_s: Vec<f64>,
    /// The states, in order; empty for a static model.
    #[serde(with = "table", default)]
    pub states: Vec<(String, StateEntry)>,
    /// The parameters, in order.
    #[serde(with = "table", default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<(String, ParameterEntry)>,
    /// Named expressions, available to equations and to later definitions.
    #[serde(with = "table", default, skip_serializing_if = "Vec::is_empty")]
    pub definitions: Vec<(String, String)>,
    /// Initial states of a window of a log, as expressions in its first row. Other states start from their column, else from `initial`.
    #[serde(with = "table", default, skip_serializing_if = "Vec::is_empty")]
    pub starts: Vec<(String, String)>,
    /// dx/dt of each state.
    #[serde(with = "table", default)]
    pub derivatives: Vec<(String, String)>,
    /// Each output.
    #[serde(with = "table")]
    pub output_equations: Vec<(String, String)>,
    /// Outputs with a common error measure; an output outside all groups is its own group.
    #[serde(with = "table", default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<(String, GroupEntry)>,
    /// Effects that are part of the simulator.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectEntry>,
    /// Terms that may be missing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub candidates: Vec<CandidateEntry>,
    /// Values that are unknown in every log and no cause of a gap.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nuisances: Vec<NuisanceEntry>,
}

/// Channels without the operating point, which only linear models have.
fn without_operating<S: Serializer>(
    channels: &[Channel],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Named<'a> {
        name: &'a str,
        #[serde(skip_serializing_if = "Option::is_none")]
        unit: Option<&'a str>,
        #[serde(skip_serializing_if = "Option::is_none")]
        derivative_of: Option<&'a str>,
        #[serde(skip_serializing_if = "Option::is_none")]
        kind: Option<ChannelKind>,
    }
    let named = |c| {
        let Channel { name, unit, derivative_of, kind, .. }: &Channel = c;
        Named { name, unit: unit.as_deref(), derivative_of: derivative_of.as_deref(), kind: *kind }
    };
    serializer.collect_seq(channels.iter().map(named))
}

/// The value of a key.
fn entry<'a, T>(table: &'a Table<T>, key: &str) -> Option<&'a T> {
    table.iter().find(|(name, _)| name == key).map(|(_, value)| value)
}

impl EquationsFile {
    /// The names of parameters that are exact.
    pub(crate) fn known_parameters(&self) -> Vec<String> {
        self.parameters.iter().filter(|(_, p)| p.known).map(|(name, _)| name.clone()).collect()
    }

    /// A file for compiled equations.
    #[must_use]
    pub fn from_equations(name: &str, model: &Equations) -> Self {
        let channel =
            |name: &str, unit: Option<&String>| Channel::plain(name, unit.map(String::as_str));
        let states = model.state_variables();
        let outputs = model.output_variables();
        Self {
            inputs: model
                .input_symbols()
                .iter()
                .map(|s| channel(&s.name, s.unit.as_ref()))
                .collect(),
            outputs: outputs.iter().map(|o| channel(&o.name, o.unit.as_ref())).collect(),
            states: states
                .iter()
                .map(|s| {
                    (
                        s.name.clone(),
                        StateEntry {
                            unit: s.unit.clone(),
                            initial: s.initial,
                            initial_std: s.initial_std,
                        },
                    )
                })
                .collect(),
            parameters: model
                .parameters()
                .iter()
                .map(|p| (p.name.clone(), ParameterEntry::new(p.unit.clone(), p.value)))
                .collect(),
            definitions: model
                .definitions()
                .iter()
                .map(|d| (d.name.clone(), d.expression.clone()))
                .collect(),
            derivatives: states.iter().map(|s| (s.name.clone(), s.derivative.clone())).collect(),
            output_equations: outputs
                .iter()
                .map(|o| (o.name.clone(), o.equation.clone()))
                .collect(),
            ..Self::empty(name)
        }
    }

    /// An empty file.
    pub(super) fn empty(name: &str) -> Self {
        Self {
            format: FORMAT.to_owned(),
            name: name.to_owned(),
            kind: "equations".to_owned(),
            sample_time_s: 0.0,
            inputs: Vec::new(),
            outputs: Vec::new(),
            input_delay_s: Vec::new(),
            states: Vec::new(),
            parameters: Vec::new(),
            definitions: Vec::new(),
            starts: Vec::new(),
            derivatives: Vec::new(),
            output_equations: Vec::new(),
            groups: Vec::new(),
            effects: Vec::new(),
            candidates: Vec::new(),
            nuisances: Vec::new(),
        }
    }

    /// Reads and checks a model file.
    ///
    /// # Errors
    /// [`FileError`](deadtime_signal::file::FileError), or a [`ModelError`] with the file and the fault.
    pub fn read(path: &Path) -> Result<Self> {
        let (text, syntax) = read_text(path)?;
        Ok(Self::parse(&text, syntax, path)?)
    }

    pub(super) fn parse(text: &str, syntax: Syntax, path: &Path) -> Result<Self, ModelError> {
        let kind = super::text::kind(text, syntax, path)?;
        if kind != "equations" {
            return Err(ModelError::Kind {
                path: path.to_owned(),
                key: "kind",
                found: kind,
                known: "equations here",
            });
        }
        let file: Self = parse_text(text, syntax, path)?;
        file.check(path)?;
        Ok(file)
    }

    fn check(&self, path: &Path) -> Result<(), ModelError> {
        check_sizes(
            path,
            [self.inputs.len(), self.states.len(), self.parameters.len(), self.outputs.len()],
        )?;
        check_channels(path, &self.inputs, &self.outputs)?;
        check_nuisances(path, &self.nuisances)?;
        check_list(
            path,
            "input_delay_s",
            &self.input_delay_s,
            self.inputs.len(),
            Sign::NotNegative,
        )?;
        if self.sample_time_s != 0.0 {
            let rule = "equations are in continuous time; leave it out";
            return Err(number(path, "sample_time_s", self.sample_time_s, rule));
        }
        self.check_groups(path)?;
        let rule = "only a linear model has an operating point; leave it out";
        let mut operating = self.inputs.iter().chain(&self.outputs).map(|c| c.operating);
        if let Some(operating) = operating.find(|o| *o != Operating::default()) {
            let value = if let Operating::Value(value) = operating { value } else { f64::NAN };
            return Err(number(path, "operating", value, rule));
        }
        self.compile_starts(path)?;
        self.compile_candidates(path)?;
        self.compile(path).map(drop)
    }

    /// Groups and slopes refer to existing names.
    fn check_groups(&self, path: &Path) -> Result<(), ModelError> {
        let unmatched = |what, name: &str, lacks| Err(unmatched(path, what, name, lacks));
        for input in &self.inputs {
            if let Some(of) = &input.derivative_of
                && !self.inputs.iter().any(|i| i.name == *of && i.derivative_of.is_none())
            {
                return unmatched(
                    "`derivative_of`",
                    of,
                    "is no input that is measured itself; name one of `inputs`",
                );
            }
        }
        let mut seen: Vec<&String> = Vec::new();
        for (name, group) in &self.groups {
            for output in &group.outputs {
                if !self.outputs.iter().any(|o| o.name == *output) {
                    return unmatched(
                        "the group's output",
                        output,
                        "is none of `outputs`; correct its name",
                    );
                }
                if seen.contains(&output) {
                    return unmatched(
                        "the output",
                        output,
                        "stands in a group twice; leave it in one",
                    );
                }
                seen.push(output);
            }
            if group.outputs.is_empty() {
                return unmatched("the group", name, "has no output; name some");
            }
            if group.kind == GroupKind::Attitude && group.outputs.len() != 4 {
                return unmatched(
                    "the attitude",
                    name,
                    "needs four outputs, a quaternion with its scalar last",
                );
            }
        }
        Ok(())
    }

    /// The compiled model.
    ///
    /// # Errors
    /// [`ModelError::Equations`], which points into the expression; [`ModelError::Unmatched`] for a state without a derivative and similar faults.
    pub fn equations(&self) -> Result<Equations, ModelError> {
        self.compile(Path::new(&self.name))
    }

    /// The initial states as the outputs of a model with the same names, one output named after each state; `None` without any in the file.
    ///
    /// # Errors
    /// As [`Self::equations`].
    pub fn start_equations(&self) -> Result<Option<Equations>, ModelError> {
        self.compile_starts(Path::new(&self.name))
    }

    /// The compiled model with the file's candidates; `None` without candidates.
    ///
    /// # Errors
    /// As [`Self::equations`], and [`ModelError::Candidate`].
    pub fn candidates(&self) -> Result<Option<Candidates>, ModelError> {
        self.compile_candidates(Path::new(&self.name))
    }

    /// Every entry of a table belongs to a state.
    fn of_states(
        &self,
        path: &Path,
        what: &'static str,
        table: &Table<String>,
    ) -> Result<(), ModelError> {
        match table.iter().find(|(name, _)| entry(&self.states, name).is_none()) {
            Some((name, _)) => {
                let lacks = "belongs to no state; add it to [states] or correct its name";
                Err(unmatched(path, what, name, lacks))
            }
            None => Ok(()),
        }
    }

    fn compile_starts(&self, path: &Path) -> Result<Option<Equations>, ModelError> {
        if self.starts.is_empty() {
            return Ok(None);
        }
        self.of_states(path, "the start", &self.starts)?;
        let outputs = self.starts.iter().map(|(name, _)| Channel::plain(name, None)).collect();
        Self {
            outputs,
            output_equations: self.starts.clone(),
            starts: Vec::new(),
            groups: Vec::new(),
            ..self.clone()
        }
        .compile(path)
        .map(Some)
    }

    pub(super) fn compile(&self, path: &Path) -> Result<Equations, ModelError> {
        self.of_states(path, "the derivative", &self.derivatives)?;
        let output = |name: &str| self.outputs.iter().any(|o| o.name == name);
        if let Some((name, _)) = self.output_equations.iter().find(|(name, _)| !output(name)) {
            let lacks = "belongs to no output; add it to `outputs` or correct its name";
            return Err(unmatched(path, "the output equation", name, lacks));
        }
        let states = self.states.iter().map(|(name, state)| {
            let derivative = entry(&self.derivatives, name).ok_or_else(|| {
                let lacks = "has no derivative; add its equation to [derivatives]";
                unmatched(path, "the state", name, lacks)
            })?;
            let StateEntry { unit, initial, initial_std } = state.clone();
            Ok(StateVariable {
                name: name.clone(),
                unit,
                initial,
                initial_std,
                derivative: derivative.clone(),
            })
        });
        let states = states.collect::<Result<_, ModelError>>()?;
        let outputs = self.outputs.iter().map(|output| {
            let equation = entry(&self.output_equations, &output.name).ok_or_else(|| {
                let lacks = "has no equation; add one to [output_equations]";
                unmatched(path, "the output", &output.name, lacks)
            })?;
            Ok(OutputVariable {
                name: output.name.clone(),
                unit: output.unit.clone(),
                equation: equation.clone(),
            })
        });
        let outputs = outputs.collect::<Result<_, ModelError>>()?;
        let inputs = self
            .inputs
            .iter()
            .map(|c| Symbol { name: c.name.clone(), unit: c.unit.clone() })
            .collect();
        let parameter = |(name, entry): &(String, ParameterEntry)| Parameter {
            name: name.clone(),
            unit: entry.unit.clone(),
            value: entry.value,
        };
        let parameters = self.parameters.iter().map(parameter).collect();
        let wrong = |source: EquationError| ModelError::Equations {
            path: path.to_owned(),
            source: Box::new(source),
        };
        let definition = |(name, expression): &(String, String)| Definition {
            name: name.clone(),
            expression: expression.clone(),
        };
        let definitions = self.definitions.iter().map(definition).collect();
        Equations::with_definitions(inputs, states, parameters, definitions, outputs).map_err(wrong)
    }

    /// Writes the file, as TOML or JSON by its extension.
    ///
    /// # Errors
    /// [`FileError`](deadtime_signal::file::FileError), [`ModelError::Extension`].
    pub fn write(&self, path: &Path) -> Result<()> {
        write_text(path, self, syntax(path)?)
    }

    /// The file's text as TOML.
    ///
    /// # Errors
    /// [`ModelError::File`] if the writer refuses it.
    pub fn to_toml(&self) -> Result<String, ModelError> {
        super::text::text(self, Syntax::Toml)
            .map_err(|detail| ModelError::File { path: self.name.clone().into(), detail })
    }
}
