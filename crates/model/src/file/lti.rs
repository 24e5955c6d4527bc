//! The model file of a linear model, `kind = "lti"`.

use std::path::Path;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::candidate::CandidateEntry;
use super::channel::{Channel, EffectEntry, Operating, named};
use super::check::{
    Sign, check_channels, check_list, check_names, check_sample_time, check_sizes, number,
    unmatched,
};
use super::equations::{EquationsFile, ParameterEntry, StateEntry};
use super::nuisance::{NuisanceEntry, check_nuisances};
use super::table::Table;
use super::text::{FORMAT, Syntax, syntax, write_text};
use crate::c2d::conversion::Conversion;
use crate::error::{ModelError, Result};
use crate::state_space::{Continuous, Sampled, StateSpace};
use deadtime_signal::time::SampleTime;

named!(State, "a state", |name: &str| State { name: name.to_owned(), unit: None });

/// A state; in a file alternatively its name alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self")]
pub struct State {
    /// Its name.
    pub name: String,
    /// Its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// A linear model with names, units and initial state, ready for simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    format: String,
    /// The model's name.
    pub name: String,
    kind: String,
    /// 0 or absent: continuous time.
    #[serde(default)]
    pub sample_time_s: f64,
    /// The inputs.
    pub inputs: Vec<Channel>,
    /// The states.
    pub states: Vec<State>,
    /// The outputs.
    pub outputs: Vec<Channel>,
    /// One delay per input, s; empty: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub input_delay_s: Vec<f64>,
    /// The state at the start of a log; empty: 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub initial: Vec<f64>,
    /// Standard deviation of `initial`; empty: unknown initial state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub initial_std: Vec<f64>,
    /// Entries of A and B with exact values, as `A_phi_p` for φ' = p; a fit of `all` parameters keeps them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub known: Vec<String>,
    #[serde(rename = "A")]
    a: Vec<Vec<f64>>,
    #[serde(rename = "B")]
    b: Vec<Vec<f64>>,
    #[serde(rename = "C")]
    c: Vec<Vec<f64>>,
    /// Empty: 0.
    #[serde(rename = "D", default)]
    d: Vec<Vec<f64>>,
    /// Effects that are part of the simulator.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectEntry>,
    /// Terms that may be missing; a model with such terms is simulated as equations.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub candidates: Vec<CandidateEntry>,
    /// Values that are unknown in every log and no cause of a gap.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nuisances: Vec<NuisanceEntry>,
}

impl ModelFile {
    pub(super) fn check(&self, path: &Path) -> Result<(), ModelError> {
        let states: Vec<&str> = self.states.iter().map(|s| s.name.as_str()).collect();
        check_sizes(path, [self.inputs.len(), states.len(), 0, self.outputs.len()])?;
        check_channels(path, &self.inputs, &self.outputs)?;
        check_names(path, "state", &states)?;
        check_nuisances(path, &self.nuisances)?;
        check_list(
            path,
            "input_delay_s",
            &self.input_delay_s,
            self.inputs.len(),
            Sign::NotNegative,
        )?;
        check_list(path, "initial", &self.initial, states.len(), Sign::Any)?;
        check_list(path, "initial_std", &self.initial_std, states.len(), Sign::NotNegative)?;
        check_sample_time(path, self.sample_time_s)?;
        self.check_known(path)?;
        let named =
            |e: ModelError| ModelError::File { path: path.to_owned(), detail: e.to_string() };
        if !self.candidates.is_empty() {
            self.to_equations([&[], &[], &[]])?.compile_candidates(path)?;
        }
        if self.sample_time_s > 0.0 {
            self.sampled().map(drop).map_err(named)
        } else {
            self.continuous().map(drop).map_err(named)
        }
    }

    /// Every entry marked as known is a nonzero entry of A or B.
    fn check_known(&self, path: &Path) -> Result<(), ModelError> {
        if self.known.is_empty() {
            return Ok(());
        }
        if self.is_sampled() {
            let rule = "entries of a sampled model are no parameters";
            return Err(unmatched(path, "`known`", &self.known.join(", "), rule));
        }
        let parameters = self.to_equations([&[], &[], &[]])?.parameters;
        for name in &self.known {
            if !parameters.iter().any(|(entry, _)| entry == name) {
                let rule = "is no entry of A or B that is not 0; write it as A_state_from or B_state_input";
                return Err(unmatched(path, "`known`", name, rule));
            }
        }
        Ok(())
    }

    /// A file for a continuous model.
    ///
    /// # Errors
    /// [`ModelError::Count`] where names and matrices do not match.
    pub fn from_continuous(
        name: &str,
        sys: &StateSpace<Continuous>,
        inputs: Vec<Channel>,
        states: Vec<State>,
        outputs: Vec<Channel>,
    ) -> Result<Self, ModelError> {
        let delays = sys.input_delay().to_vec();
        Self::from_matrices(
            name,
            0.0,
            [sys.a(), sys.b(), sys.c(), sys.d()],
            delays,
            (inputs, states, outputs),
        )
    }

    /// A file for a sampled model. States added by a conversion get generated names where `states` is too short.
    ///
    /// # Errors
    /// [`ModelError::Count`] where names and matrices do not match.
    pub fn from_sampled(
        name: &str,
        sys: &StateSpace<Sampled>,
        inputs: Vec<Channel>,
        mut states: Vec<State>,
        outputs: Vec<Channel>,
    ) -> Result<Self, ModelError> {
        let ts = sys.sample_time();
        let delays = sys.input_delay().iter().map(|&d| ts.to_seconds(d as f64)).collect();
        // A realisation of another kind, or with fewer states than names (after cancellation), gets generated names.
        if sys.order() < states.len() {
            states.clear();
        }
        for i in states.len()..sys.order() {
            states.push(State { name: format!("x{}", i + 1), unit: None });
        }
        Self::from_matrices(
            name,
            ts.seconds(),
            [sys.a(), sys.b(), sys.c(), sys.d()],
            delays,
            (inputs, states, outputs),
        )
    }

    /// The sampled model of a continuous one, for all its channels or for one output and input (counted from 0).
    ///
    /// # Errors
    /// [`ModelError::Effects`], [`ModelError::Domain`], and the errors of the conversion.
    pub fn c2d(
        &self,
        conversion: &dyn Conversion,
        sample_time: SampleTime,
        pair: Option<(usize, usize)>,
    ) -> Result<Self, ModelError> {
        if !self.effects.is_empty() {
            return Err(ModelError::Effects { name: self.name.clone() });
        }
        let mut sys = self.continuous()?;
        let (mut inputs, mut outputs) = (self.inputs.clone(), self.outputs.clone());
        if let Some((output, input)) = pair {
            sys = sys.pair(output, input)?;
            (inputs, outputs) =
                (vec![inputs.swap_remove(input)], vec![outputs.swap_remove(output)]);
        }
        let sampled = conversion.c2d(&sys, sample_time)?;
        let mut result =
            Self::from_sampled(&self.name, &sampled, inputs, self.states.clone(), outputs)?;
        // The initial state applies only to the file's own states.
        if sampled.order() == self.states.len() && conversion.keeps_states() {
            (result.initial, result.initial_std) = (self.initial.clone(), self.initial_std.clone());
        }
        if pair.is_none() {
            result.nuisances.clone_from(&self.nuisances);
        }
        Ok(result)
    }

    pub(super) fn from_matrices(
        name: &str,
        sample_time_s: f64,
        [a, b, c, d]: [&DMatrix<f64>; 4],
        input_delay_s: Vec<f64>,
        (inputs, states, outputs): (Vec<Channel>, Vec<State>, Vec<Channel>),
    ) -> Result<Self, ModelError> {
        for (what, got, needed) in [
            ("input names", inputs.len(), d.ncols()),
            ("state names", states.len(), a.nrows()),
            ("output names", outputs.len(), d.nrows()),
        ] {
            if got != needed {
                return Err(ModelError::Count { what, needed, got });
            }
        }
        let rows = |m: &DMatrix<f64>| m.row_iter().map(|r| r.iter().copied().collect()).collect();
        Ok(Self {
            format: FORMAT.to_owned(),
            name: name.to_owned(),
            kind: "lti".to_owned(),
            sample_time_s,
            inputs,
            states,
            outputs,
            input_delay_s,
            initial: Vec::new(),
            initial_std: Vec::new(),
            known: Vec::new(),
            a: rows(a),
            b: rows(b),
            c: rows(c),
            d: rows(d),
            effects: Vec::new(),
            candidates: Vec::new(),
            nuisances: Vec::new(),
        })
    }

    /// The same model as equations, with its nonzero entries of A and B as parameters `A_x_from` and `B_x_from`. The operating points are those of the inputs,
    /// the states and the outputs (0 where a list is too short).
    ///
    /// # Errors
    /// [`ModelError::Domain`] if it is sampled; [`ModelError::Equations`] for a name that is invalid in an expression.
    pub fn to_equations(
        &self,
        [about_inputs, about_states, about_outputs]: [&[f64]; 3],
    ) -> Result<EquationsFile, ModelError> {
        let sys = self.continuous()?;
        let deviation = |name: &str, about: Option<&f64>| match about {
            Some(about) if *about != 0.0 => format!("({name} - ({about:e}))"),
            _ => name.to_owned(),
        };
        let deviations = |names: &mut dyn Iterator<Item = &String>, about: &[f64]| {
            names.enumerate().map(|(i, name)| deviation(name, about.get(i))).collect::<Vec<_>>()
        };
        let states = deviations(&mut self.states.iter().map(|s| &s.name), about_states);
        let inputs = deviations(&mut self.inputs.iter().map(|c| &c.name), about_inputs);
        let (parameters, derivatives) = self.entries(&sys, &states, &inputs);
        let output = |(i, channel): (usize, &Channel)| {
            let mut equation = format!("{:e}", about_outputs.get(i).copied().unwrap_or(0.0));
            let of_states = states.iter().map(|x| (sys.c(), x));
            let of_inputs = inputs.iter().map(|u| (sys.d(), u));
            for (j, (matrix, value)) in of_states.enumerate().chain(of_inputs.enumerate()) {
                if matrix[(i, j)] != 0.0 {
                    equation.push_str(&format!(" + ({:e})*{value}", matrix[(i, j)]));
                }
            }
            (channel.name.clone(), equation)
        };
        let plain = |channels: &[Channel]| {
            channels
                .iter()
                .map(|c| Channel { operating: Operating::default(), ..c.clone() })
                .collect()
        };
        let state = |(i, state): (usize, &State)| {
            let at = |list: &[f64]| list.get(i).copied();
            let (initial, initial_std) = (
                at(&self.initial).unwrap_or(0.0) + at(about_states).unwrap_or(0.0),
                at(&self.initial_std),
            );
            (state.name.clone(), StateEntry { unit: state.unit.clone(), initial, initial_std })
        };
        Ok(EquationsFile {
            inputs: plain(&self.inputs),
            outputs: plain(&self.outputs),
            input_delay_s: self.input_delay_s.clone(),
            states: self.states.iter().enumerate().map(state).collect(),
            parameters,
            derivatives,
            output_equations: self.outputs.iter().enumerate().map(output).collect(),
            effects: self.effects.clone(),
            candidates: self.candidates.clone(),
            nuisances: self.nuisances.clone(),
            ..EquationsFile::empty(&self.name)
        })
    }

    /// The nonzero entries of A and B as parameters, and each state's derivative in terms of them.
    fn entries(
        &self,
        sys: &StateSpace<Continuous>,
        states: &[String],
        inputs: &[String],
    ) -> (Table<ParameterEntry>, Table<String>) {
        let mut parameters = Vec::new();
        let mut derivatives = Vec::new();
        for (i, state) in self.states.iter().map(|s| s.name.as_str()).enumerate() {
            let mut derivative = "0".to_owned();
            let of_states =
                self.states.iter().zip(states).map(|(s, x)| ("A", sys.a(), s.name.as_str(), x));
            let of_inputs =
                self.inputs.iter().zip(inputs).map(|(c, u)| ("B", sys.b(), c.name.as_str(), u));
            for (j, (letter, matrix, column, value)) in
                of_states.enumerate().chain(of_inputs.enumerate())
            {
                if matrix[(i, j)] != 0.0 {
                    let name = format!("{letter}_{state}_{column}");
                    derivative.push_str(&format!(" + {name}*{value}"));
                    let known = self.known.contains(&name);
                    let entry = ParameterEntry { unit: None, value: matrix[(i, j)], known };
                    parameters.push((name, entry));
                }
            }
            derivatives.push((state.to_owned(), derivative));
        }
        (parameters, derivatives)
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

    fn matrices(&self) -> Result<[DMatrix<f64>; 4], ModelError> {
        let (n, m, p) = (self.states.len(), self.inputs.len(), self.outputs.len());
        let matrix = |matrix: &'static str, rows: &[Vec<f64>], needed: (usize, usize)| {
            // Without states the file may write [] for a matrix of no rows or of no columns.
            let columns = rows
                .iter()
                .find(|r| r.len() != needed.1)
                .or(rows.first())
                .map_or(needed.1, Vec::len);
            if rows.len() != needed.0 || columns != needed.1 {
                let (got_rows, got_columns) = (rows.len(), columns);
                let (rows, columns) = needed;
                return Err(ModelError::Shape { matrix, rows, columns, got_rows, got_columns });
            }
            Ok(DMatrix::from_row_iterator(needed.0, needed.1, rows.iter().flatten().copied()))
        };
        Ok([
            matrix("A", &self.a, (n, n))?,
            matrix("B", &self.b, (n, m))?,
            matrix("C", &self.c, (p, n))?,
            match self.d.is_empty() {
                true => DMatrix::zeros(p, m),
                false => matrix("D", &self.d, (p, m))?,
            },
        ])
    }

    fn delays(&self) -> Vec<f64> {
        if self.input_delay_s.is_empty() {
            vec![0.0; self.inputs.len()]
        } else {
            self.input_delay_s.clone()
        }
    }

    fn must_be(
        &self,
        needed: &'static str,
        found: &'static str,
        is: bool,
    ) -> Result<(), ModelError> {
        let name = || self.name.clone();
        let what = "this step";
        if is { Ok(()) } else { Err(ModelError::Domain { what, needed, name: name(), found }) }
    }

    /// The continuous model.
    ///
    /// # Errors
    /// [`ModelError::Domain`] if it is sampled, [`ModelError::Shape`] or [`ModelError::NotFinite`].
    pub fn continuous(&self) -> Result<StateSpace<Continuous>, ModelError> {
        self.must_be("continuous", "sampled", !self.is_sampled())?;
        let [a, b, c, d] = self.matrices()?;
        StateSpace::continuous(a, b, c, d)?.with_input_delay(self.delays())
    }

    /// The sampled model; a delay that is no multiple of the sample time is an error.
    ///
    /// # Errors
    /// [`ModelError::Domain`] if it is continuous, [`ModelError::Shape`], [`ModelError::NotFinite`] or [`ModelError::Number`].
    pub fn sampled(&self) -> Result<StateSpace<Sampled>, ModelError> {
        self.must_be("sampled", "continuous", self.is_sampled())?;
        let ts = SampleTime::new(self.sample_time_s)?;
        let [a, b, c, d] = self.matrices()?;
        let mut whole = Vec::with_capacity(self.inputs.len());
        for delay_s in self.delays() {
            let delay = ts.samples(delay_s)?;
            if delay.fraction != 0.0 {
                let rule = "a sampled model's delays are multiples of its sample time; convert the continuous model instead";
                return Err(number(Path::new(&self.name), "input_delay_s", delay_s, rule));
            }
            whole.push(delay.whole);
        }
        StateSpace::sampled(a, b, c, d, ts)?.with_input_delay(whole)
    }

    /// Sampled, not continuous.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        self.sample_time_s > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::file::channel::{Mean, Operating};
    use crate::uav::Dynamics;

    const LATERAL: &str = r#"
format = "deadtime/model@1"
name   = "lateral"
kind   = "lti"
sample_time_s = 0.0
inputs  = [{ name = "delta_lat", unit = "1", operating = "mean" }]
states  = [{ name = "v", unit = "m/s" }, { name = "p", unit = "rad/s" }, { name = "phi", unit = "rad" }]
outputs = [{ name = "p", unit = "rad/s" }, { name = "ay", unit = "m/s^2", operating = 0.5 }]
input_delay_s = [0.031]
initial_std = [0.0, 0.1, 0.0]
A = [[-0.211, 0, 9.81], [-3.613, 0.0, 0.0], [0.0, 1.0, 0.0]]
B = [[9.379], [851.287], [0.0]]
C = [[0.0, 1.0, 0.0], [-0.211, 0.0, 0.0]]
D = [[0.0], [9.379]]
[[effects]]
effect = "input_delay"
channel = "delta_lat"
parameters = { delay = 0.031 }
"#;

    fn parse(text: &str) -> std::result::Result<ModelFile, ModelError> {
        ModelFile::parse(text, Syntax::Toml, Path::new("m.toml"))
    }

    #[test]
    fn names_alone_are_channels_and_states_and_no_direct_path_is_zero() {
        let plain = |list: &str, table: &str| {
            parse(&format!(
                "format = \"deadtime/model@1\"\nname = \"m\"\nkind = \"lti\"\ninputs = [{list}]\nstates = [\"x\"]\noutputs = [{table}]\nA = [[-1.0]]\nB = [[2.0]]\nC = [[1.0]]\n"
            ))
        };
        let short = plain("\"u\"", "\"y\"").unwrap();
        let long = plain("{ name = \"u\" }", "{ name = \"y\" }").unwrap();
        assert_eq!(short.inputs, long.inputs);
        assert_eq!(short.outputs, long.outputs);
        assert_eq!(short.continuous().unwrap().d()[(0, 0)], 0.0);
        assert_eq!(short.to_toml().unwrap(), long.to_toml().unwrap());
        let said = plain("3", "\"y\"").unwrap_err().to_string();
        assert!(said.contains("an input or output: its name or a table"), "{said}");
        let said = plain("{ name = \"u\", units = \"V\" }", "\"y\"").unwrap_err().to_string();
        assert!(said.contains("unknown field `units`"), "{said}");
    }

    #[test]
    fn the_documented_example_is_the_thesis_model() {
        let file = parse(LATERAL).unwrap();
        let model = Dynamics::Lateral.model().with_input_delay(vec![0.031]).unwrap();
        assert_eq!(file.continuous().unwrap(), model);
        assert_eq!(file.inputs[0].operating, Operating::Mean(Mean::Mean));
        assert_eq!(file.outputs[1].operating, Operating::Value(0.5));
        assert_eq!(file.effects[0].parameters["delay"], 0.031);
        assert!(file.sampled().is_err());
    }

    #[test]
    fn writing_and_reading_gives_the_same_model_in_both_syntaxes() {
        let file = parse(LATERAL).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.toml", "a.json"] {
            let path = folder.path().join(name);
            file.write(&path).unwrap();
            assert_eq!(ModelFile::read(&path).unwrap(), file, "{name}");
        }
    }

    #[test]
    fn every_fault_names_the_file_and_the_fault() {
        for (from, to, expect) in [
            ("model@1", "model@9", "deadtime/model@1"),
            ("\"lti\"", "\"equations\"", "lti"),
            ("\"lti\"", "\"fuzzy\"", "equations"),
            ("name   = \"lateral\"", "nmae = \"lateral\"", "nmae"),
            ("[[9.379], [851.287], [0.0]]", "[[9.379], [851.287]]", "matrix B is 2 by 1"),
            ("[[0.0], [9.379]]", "[[0.0], [nan]]", "matrix D"),
            ("input_delay_s = [0.031]", "input_delay_s = [-1.0]", "input_delay_s"),
            ("input_delay_s = [0.031]", "input_delay_s = [0.1, 0.2]", "input_delay_s"),
            ("name = \"phi\"", "name = \"p\"", "named twice"),
            ("sample_time_s = 0.0", "sample_time_s = -0.1", "sample_time_s"),
            ("operating = 0.5", "operating = \"median\"", "operating"),
        ] {
            assert!(LATERAL.contains(from));
            let message = parse(&LATERAL.replace(from, to)).unwrap_err().to_string();
            assert!(message.contains("m.toml") && message.contains(expect), "{to}: {message}");
        }
        assert!(matches!(
            ModelFile::read(Path::new("m.yaml")),
            Err(Error::Model(ModelError::Extension { .. }))
        ));
        assert!(matches!(ModelFile::read(Path::new("no/such.toml")), Err(Error::File(_))));
    }

    #[test]
    fn a_sampled_model_must_have_whole_delays() {
        let text = LATERAL.replace("sample_time_s = 0.0", "sample_time_s = 0.01");
        assert!(parse(&text).unwrap_err().to_string().contains("multiples of its sample time"));
        assert!(
            parse(&text.replace("input_delay_s = [0.031]", "input_delay_s = [0.03]"))
                .unwrap()
                .sampled()
                .is_ok()
        );
    }
}
