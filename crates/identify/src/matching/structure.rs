//! The structured model as a function of its free parameters: equations linearised at an operating point, in the time domain of the identified model.

use nalgebra::DMatrix;

use super::error::MatchingError;
use super::options::Matching;
use super::system::{GainMatrix, Matrices, System};
use super::target::Target;
use crate::error::Result;
use crate::structured::free::delay_name;
use deadtime_model::{Channel, Equations, EquationsFile, ModelError, Operating, StateSpace};

/// Relative step of central differences: entries are mostly linear in the parameters, so that only rounding remains.
const STEP: f64 = 1e-6;

/// A parameter of the equations, or the delay of an input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Free {
    Parameter(usize),
    Delay(usize),
}

pub(super) struct Structure<'a> {
    file: &'a EquationsFile,
    equations: Equations,
    /// The point of the linearisation.
    x: Vec<f64>,
    u: Vec<f64>,
    /// Its outputs and inputs in the order of the match, with their units.
    outputs: Vec<(usize, f64)>,
    inputs: Vec<(usize, f64)>,
    pub(super) free: Vec<Free>,
    pub(super) nominal: Vec<f64>,
    /// The identified model, of the same channels.
    pub(super) target: System,
    pub(super) deviations: Vec<System>,
    /// Notes for the reader.
    pub(super) notes: Vec<String>,
}

impl<'a> Structure<'a> {
    pub(super) fn new(
        options: &Matching,
        file: &'a EquationsFile,
        target: &Target,
    ) -> Result<Self> {
        let unsupported =
            |what, remedy| MatchingError::Unsupported { model: file.name.clone(), what, remedy };
        if !file.effects.is_empty() {
            return Err(
                unsupported("effects", "write them into its equations, or take them out").into()
            );
        }
        if file.inputs.iter().any(|c| c.derivative_of.is_some()) {
            return Err(unsupported(
                "inputs that are slopes of others",
                "write the slope into its equations as a state",
            )
            .into());
        }
        let equations = file.equations()?;
        let (outputs, inputs, notes) = channels(options, file, target)?;
        let (x, u) = point(options, file, target)?;
        let free = free(options, file, &inputs)?;
        let delays = &file.input_delay_s;
        let nominal = free
            .iter()
            .map(|f| match *f {
                Free::Parameter(i) => file.parameters[i].1.value,
                Free::Delay(j) => delays.get(j).copied().unwrap_or(0.0),
            })
            .collect();
        let own = |list: &[Shared]| list.iter().map(|c| (c.structured, c.unit)).collect::<Vec<_>>();
        let theirs =
            |list: &[Shared]| list.iter().map(|c| (c.identified, c.unit)).collect::<Vec<_>>();
        let selected = |sys: &System| sys.selected(&theirs(&outputs), &theirs(&inputs));
        let mut structure = Self {
            file,
            equations,
            x,
            u,
            outputs: own(&outputs),
            inputs: own(&inputs),
            free,
            nominal,
            target: selected(&target.system)?,
            deviations: target
                .deviations
                .iter()
                .map(selected)
                .collect::<std::result::Result<_, ModelError>>()?,
            notes,
        };
        structure.note_unrest();
        Ok(structure)
    }

    pub(super) fn name(&self, at: usize) -> String {
        match self.free[at] {
            Free::Parameter(i) => self.file.parameters[i].0.clone(),
            Free::Delay(j) => delay_name(&self.file.inputs[j].name),
        }
    }

    pub(super) fn unit(&self, at: usize) -> Option<String> {
        match self.free[at] {
            Free::Parameter(i) => self.file.parameters[i].1.unit.clone(),
            Free::Delay(_) => Some("s".to_owned()),
        }
    }

    /// The identified model's delay of the same input, s, and the sample time of which it is a multiple (0 in continuous time).
    pub(super) fn identified_delay_s(&self, at: usize) -> Option<(f64, f64)> {
        let Free::Delay(j) = self.free[at] else { return None };
        let shared = self.inputs.iter().position(|(own, _)| *own == j)?;
        Some(match &self.target {
            System::Continuous(sys) => (sys.input_delay()[shared], 0.0),
            System::Sampled(sys) => (
                sys.sample_time().to_seconds(sys.input_delay()[shared] as f64),
                sys.sample_time().seconds(),
            ),
        })
    }

    /// The outputs of the match, by name.
    pub(super) fn output_names(&self, target: &Target) -> Vec<String> {
        let own = |name: &String| self.file.outputs.iter().any(|c| c.name == *name);
        target.outputs.iter().map(|c| c.name.clone()).filter(own).collect()
    }

    /// The file with these values.
    pub(super) fn file_with(&self, values: &[f64]) -> EquationsFile {
        let mut file = self.file.clone();
        for (free, &value) in self.free.iter().zip(values) {
            match *free {
                Free::Parameter(i) => file.parameters[i].1.value = value,
                Free::Delay(j) => {
                    file.input_delay_s.resize(file.inputs.len(), 0.0);
                    file.input_delay_s[j] = value;
                }
            }
        }
        file
    }

    /// The linear model with these values, for the match's channels, in the identified model's time domain.
    pub(super) fn system(&self, values: &[f64]) -> std::result::Result<System, ModelError> {
        let mut p = self.equations.nominal();
        let mut delays = self.file.input_delay_s.clone();
        delays.resize(self.file.inputs.len(), 0.0);
        for (free, &value) in self.free.iter().zip(values) {
            match *free {
                Free::Parameter(i) => p[i] = value,
                Free::Delay(j) => delays[j] = value,
            }
        }
        let about = self.equations.linearise(0.0, &self.x, &self.u, &p);
        let whole =
            StateSpace::continuous(about.a, about.b, about.c, about.d)?.with_input_delay(delays)?;
        match System::Continuous(whole).selected(&self.outputs, &self.inputs)? {
            System::Continuous(sys) => self.target.in_time_of(sys),
            sampled @ System::Sampled(_) => Ok(sampled),
        }
    }

    /// Responses at these frequencies and their derivatives by each value times its size. `None` where the model or one of them is not finite.
    pub(super) fn responses(
        &self,
        values: &[f64],
        sizes: &[f64],
        omegas: &[f64],
    ) -> Option<Vec<(GainMatrix, Vec<GainMatrix>)>> {
        let sys = self.system(values).ok()?;
        let beside = |at: usize, step: f64| {
            let mut moved = values.to_vec();
            moved[at] += step * sizes[at];
            self.system(&moved).ok()
        };
        let mut changes: Vec<Option<Matrices>> = Vec::new();
        let mut ends: Vec<Option<[System; 2]>> = Vec::new();
        for at in 0..self.free.len() {
            match self.free[at] {
                Free::Parameter(_) => {
                    let (up, down) = (beside(at, STEP)?.matrices(), beside(at, -STEP)?.matrices());
                    changes.push(Some(std::array::from_fn(|m| (&up[m] - &down[m]) / (2.0 * STEP))));
                    ends.push(None);
                }
                // The matrices change their size at a whole number of samples.
                Free::Delay(_) => {
                    changes.push(None);
                    ends.push(Some([
                        beside(at, STEP)?,
                        beside(at, -STEP).or_else(|| beside(at, 0.0))?,
                    ]));
                }
            }
        }
        let at = |&omega: &f64| {
            let (response, slopes) = sys.slopes(&changes, omega)?;
            let width =
                |at: usize| if values[at] - STEP * sizes[at] < 0.0 { STEP } else { 2.0 * STEP };
            let by_ends = |at: usize| {
                ends[at].as_ref().map(|[up, down]| {
                    (up.response(omega) - down.response(omega))
                        / nalgebra::Complex::new(width(at), 0.0)
                })
            };
            let slopes = slopes
                .into_iter()
                .enumerate()
                .map(|(at, s)| s.or_else(|| by_ends(at)))
                .collect::<Option<Vec<_>>>()?;
            slopes
                .iter()
                .all(|s| s.iter().all(|v| v.re.is_finite() && v.im.is_finite()))
                .then_some((response, slopes))
        };
        omegas.iter().map(at).collect()
    }

    /// The linearisation of a nonlinear model changes with time if the operating point is no equilibrium.
    fn note_unrest(&mut self) {
        let p = self.equations.nominal();
        let linear = |x: &[f64], u: &[f64]| {
            let l = self.equations.linearise(0.0, x, u, &p);
            [l.a, l.b, l.c, l.d]
        };
        let aside = |list: &[f64]| list.iter().map(|v| v + 0.125).collect::<Vec<_>>();
        if linear(&self.x, &self.u) == linear(&aside(&self.x), &aside(&self.u)) {
            return;
        }
        let mut dx = vec![0.0; self.x.len()];
        self.equations.derivatives(
            0.0,
            &self.x,
            &self.u,
            &p,
            &mut self.equations.workspace(),
            &mut dx,
        );
        let moving = self
            .file
            .states
            .iter()
            .zip(&dx)
            .filter(|(_, v)| v.abs() > 1e-6)
            .map(|((name, _), v)| format!("d{name}/dt = {v:.3e}"));
        let moving: Vec<String> = moving.collect();
        if !moving.is_empty() {
            self.notes.push(format!(
                "the structured model does not rest where it is linearised ({}): its linear model holds for a moment only; say where it rests (at)",
                moving.join(", ")
            ));
        }
    }
}

/// A channel of both models.
struct Shared {
    structured: usize,
    identified: usize,
    unit: f64,
}

fn names(list: &[Channel]) -> Vec<String> {
    list.iter().map(|c| c.name.clone()).collect()
}

/// The unit of each channel.
fn check_units(options: &Matching, target: &Target) -> Result<(), MatchingError> {
    for (name, value) in &options.units {
        if !target.inputs.iter().chain(&target.outputs).any(|c| c.name == *name) {
            let known = [names(&target.inputs), names(&target.outputs)].concat();
            return Err(MatchingError::NoName { option: "units", name: name.clone(), known });
        }
        if !(value.is_finite() && *value > 0.0) {
            let rule = "a unit must be above 0".to_owned();
            return Err(MatchingError::Option { option: "units", value: *value, rule });
        }
    }
    Ok(())
}

/// The identified model's channels in the structured one; `None` for a channel that it lacks. Errors: different units.
fn shared(
    options: &Matching,
    own: &[Channel],
    theirs: &[Channel],
) -> Result<Vec<Option<Shared>>, MatchingError> {
    let one = |(identified, channel): (usize, &Channel)| {
        let name = &channel.name;
        let Some(structured) = own.iter().position(|c| c.name == *name) else {
            return Ok(None);
        };
        if let (Some(a), Some(b)) = (&channel.unit, &own[structured].unit)
            && a != b
        {
            let (name, identified, structured) = (name.clone(), a.clone(), b.clone());
            return Err(MatchingError::Unit { name, identified, structured });
        }
        let unit = options.units.iter().find(|(n, _)| n == name).map_or(1.0, |(_, unit)| *unit);
        Ok(Some(Shared { structured, identified, unit }))
    };
    theirs.iter().enumerate().map(one).collect()
}

fn channels(
    options: &Matching,
    file: &EquationsFile,
    target: &Target,
) -> Result<(Vec<Shared>, Vec<Shared>, Vec<String>)> {
    check_units(options, target)?;
    let inputs = shared(options, &file.inputs, &target.inputs)?;
    if let Some(at) = inputs.iter().position(Option::is_none) {
        let (name, known) = (target.inputs[at].name.clone(), names(&file.inputs));
        return Err(MatchingError::NoInput { name, known }.into());
    }
    let outputs = shared(options, &file.outputs, &target.outputs)?;
    let missing: Vec<&str> = outputs
        .iter()
        .zip(&target.outputs)
        .filter(|(s, _)| s.is_none())
        .map(|(_, c)| c.name.as_str())
        .collect();
    let missing = (!missing.is_empty()).then(|| {
        format!("the structured model has no output {}: left out of the match", missing.join(", "))
    });
    let outputs: Vec<Shared> = outputs.into_iter().flatten().collect();
    if outputs.is_empty() || inputs.is_empty() {
        let (identified, structured) = (names(&target.outputs), names(&file.outputs));
        return Err(MatchingError::NoOutput { identified, structured }.into());
    }
    Ok((outputs, inputs.into_iter().flatten().collect(), missing.into_iter().collect()))
}

/// The operating point: the file's initial states and the identified model's operating inputs, overridden by `at`.
fn point(
    options: &Matching,
    file: &EquationsFile,
    target: &Target,
) -> Result<(Vec<f64>, Vec<f64>)> {
    let mut x: Vec<f64> = file.states.iter().map(|(_, s)| s.initial).collect();
    let operating = |name: &str| {
        target.inputs.iter().find(|c| c.name == name).map_or(0.0, |c| match c.operating {
            Operating::Value(v) => v,
            Operating::Mean(_) => 0.0,
        })
    };
    let mut u: Vec<f64> = file.inputs.iter().map(|c| operating(&c.name)).collect();
    for (name, value) in &options.at {
        let state = file.states.iter().position(|(n, _)| n == name);
        let input = file.inputs.iter().position(|c| c.name == *name);
        match (state, input) {
            _ if !value.is_finite() => {
                return Err(MatchingError::Option {
                    option: "at",
                    value: *value,
                    rule: "it must be finite".to_owned(),
                }
                .into());
            }
            (Some(i), _) => x[i] = *value,
            (None, Some(j)) => u[j] = *value,
            (None, None) => {
                let known = file
                    .states
                    .iter()
                    .map(|(n, _)| n.clone())
                    .chain(file.inputs.iter().map(|c| c.name.clone()))
                    .collect();
                return Err(
                    MatchingError::NoName { option: "at", name: name.clone(), known }.into()
                );
            }
        }
    }
    Ok((x, u))
}

/// For `all`: the parameters not marked as known, and the delays of the identified model's inputs.
fn free(options: &Matching, file: &EquationsFile, inputs: &[Shared]) -> Result<Vec<Free>> {
    let mut found = Vec::new();
    for name in &options.free {
        if name == "all" {
            let unknown = (0..file.parameters.len()).filter(|i| !file.parameters[*i].1.known);
            found.extend(unknown.map(Free::Parameter));
            found.extend(inputs.iter().map(|input| Free::Delay(input.structured)));
            continue;
        }
        let parameter = file.parameters.iter().position(|(n, _)| n == name).map(Free::Parameter);
        let delay =
            || file.inputs.iter().position(|c| delay_name(&c.name) == *name).map(Free::Delay);
        found.push(parameter.or_else(delay).ok_or_else(|| MatchingError::NoParameter {
            name: name.clone(),
            parameters: file.parameters.iter().map(|(n, _)| n.clone()).collect(),
            delays: file.inputs.iter().map(|c| delay_name(&c.name)).collect(),
        })?);
    }
    let mut once: Vec<Free> = Vec::new();
    for free in found {
        if !once.contains(&free) {
            once.push(free);
        }
    }
    if once.is_empty() { Err(MatchingError::NothingFree.into()) } else { Ok(once) }
}

/// The response of a model at these frequencies; `None` unless it is finite at all of them.
pub(super) fn finite_responses(sys: &System, omegas: &[f64]) -> Option<Vec<GainMatrix>> {
    let all: Vec<DMatrix<_>> = omegas.iter().map(|w| sys.response(*w)).collect();
    all.iter().all(|g| g.iter().all(|v| v.re.is_finite() && v.im.is_finite())).then_some(all)
}
