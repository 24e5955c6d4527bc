//! Equations of a model, checked and compiled.

use super::error::EquationError;
use super::explain::NonFinite;
use super::parse::{Leaf, Scope, Tree, parse, reserved};
use super::program::{Point, Program, Registers, Seeds, Sizes};
use super::{explain, token};
use crate::matrices::Matrices;
use nalgebra::DMatrix;
use std::collections::{HashMap, HashSet};

/// A name with its unit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Symbol {
    /// The name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
}

/// A state and its equation.
#[derive(Debug, Clone, PartialEq)]
pub struct StateVariable {
    /// The name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// The value at the start of a log.
    pub initial: f64,
    /// Standard deviation of `initial`, 0: exact; `None`: unknown initial state.
    pub initial_std: Option<f64>,
    /// The expression of its derivative, unit per second.
    pub derivative: String,
}

/// A named parameter of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// The name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Its nominal value.
    pub value: f64,
}

/// An output and its equation.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputVariable {
    /// The name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// The expression.
    pub equation: String,
}

/// A named expression, available to equations and to later definitions.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    /// The name.
    pub name: String,
    /// The expression.
    pub expression: String,
}

/// The variables of a derivative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Wrt {
    /// The states.
    States,
    /// The inputs.
    Inputs,
    /// The parameters.
    Parameters,
}

/// Directions in the space of states and parameters for the derivatives of an evaluation.
#[derive(Debug, Clone, Copy)]
pub struct Directions<'a> {
    /// Number of directions.
    pub count: usize,
    /// States × count, row by row: the motion of each state along each direction.
    pub states: &'a [f64],
    /// Parameters × count, row by row.
    pub parameters: &'a [f64],
}

impl<'a> Directions<'a> {
    fn seeds(self) -> Seeds<'a> {
        Seeds { states: self.states, parameters: self.parameters }
    }
}

/// A compiled nonlinear model.
///
/// Slices passed to its methods have the lengths of its lists of states, inputs and parameters (checked in tests).
///
/// ```
/// use deadtime_model::{Equations, OutputVariable, Parameter, StateVariable, Symbol};
/// let pendulum = Equations::new(
///     vec![Symbol { name: "torque".into(), unit: None }],
///     vec![
///         StateVariable { name: "angle".into(), unit: None, initial: 0.1, initial_std: None, derivative: "speed".into() },
///         StateVariable { name: "speed".into(), unit: None, initial: 0.0, initial_std: None, derivative: "torque - k*sin(angle)".into() },
///     ],
///     vec![Parameter { name: "k".into(), unit: None, value: 9.81 }],
///     vec![OutputVariable { name: "angle".into(), unit: None, equation: "angle".into() }],
/// )?;
/// let (mut workspace, mut dx) = (pendulum.workspace(), [0.0; 2]);
/// pendulum.derivatives(0.0, &[0.1, 0.5], &[2.0], &[9.81], &mut workspace, &mut dx);
/// assert_eq!(dx, [0.5, 2.0 - 9.81 * 0.1_f64.sin()]);
/// # Ok::<(), deadtime_model::EquationError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Equations {
    pub(super) inputs: Vec<Symbol>,
    pub(super) states: Vec<StateVariable>,
    pub(super) parameters: Vec<Parameter>,
    pub(super) outputs: Vec<OutputVariable>,
    pub(super) definitions: Vec<Definition>,
    pub(super) definition_trees: Vec<Tree>,
    pub(super) derivative_trees: Vec<Tree>,
    pub(super) output_trees: Vec<Tree>,
    derivative_program: Program,
    output_program: Program,
    affine: bool,
}

/// Memory of an evaluation, one per thread. A workspace of another model is allowed, and allocates once.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    derivatives: Registers,
    outputs: Registers,
}

#[derive(Clone, Copy)]
pub(super) struct Names<'a> {
    pub(super) inputs: &'a [Symbol],
    states: &'a [StateVariable],
    pub(super) parameters: &'a [Parameter],
    /// The definitions available so far.
    definitions: &'a [Definition],
}

impl Scope for Names<'_> {
    fn find(&self, name: &str) -> Option<Leaf> {
        let state = self.states.iter().position(|s| s.name == name).map(Leaf::State);
        let input = || self.inputs.iter().position(|s| s.name == name).map(Leaf::Input);
        let parameter = || self.parameters.iter().position(|s| s.name == name).map(Leaf::Parameter);
        state.or_else(input).or_else(parameter).or_else(|| (name == "time").then_some(Leaf::Time))
    }

    fn definition(&self, name: &str) -> Option<usize> {
        self.definitions.iter().position(|d| d.name == name)
    }

    fn names(&self) -> Vec<String> {
        let states = self.states.iter().map(|s| s.name.clone());
        let inputs = self.inputs.iter().map(|s| s.name.clone());
        let parameters = self.parameters.iter().map(|s| s.name.clone());
        let definitions = self.definitions.iter().map(|d| d.name.clone());
        states
            .chain(inputs)
            .chain(parameters)
            .chain(definitions)
            .chain(["time".to_owned()])
            .collect()
    }
}

impl Names<'_> {
    /// Every name is valid and has one meaning, and every value is finite.
    fn check(&self) -> Result<(), EquationError> {
        let inputs = self.inputs.iter().map(|s| ("input", "an input", &s.name));
        let states = self.states.iter().map(|s| ("state", "a state", &s.name));
        let parameters = self.parameters.iter().map(|s| ("parameter", "a parameter", &s.name));
        let mut seen = HashMap::new();
        let definitions = self.definitions.iter().map(|d| ("definition", "a definition", &d.name));
        for (what, one, name) in states.chain(inputs).chain(parameters).chain(definitions) {
            if !token::is_name(name) {
                return Err(EquationError::Name { what, name: name.clone() });
            }
            let before = seen
                .insert(name, one)
                .map(|before| if before == one { "another one of that kind" } else { before });
            if let Some(second) = reserved(name).or(before) {
                return Err(EquationError::Clash { name: name.clone(), first: one, second });
            }
        }
        let finite = "it must be finite";
        let initial = self.states.iter().map(|s| {
            (format!("states.{}.initial", s.name), s.initial, s.initial.is_finite(), finite)
        });
        let trusted = self.states.iter().filter_map(|s| s.initial_std.map(|v| (&s.name, v)));
        let trusted = trusted.map(|(name, v)| {
            (
                format!("states.{name}.initial_std"),
                v,
                v.is_finite() && v >= 0.0,
                "it must be finite and not negative",
            )
        });
        let values = self.parameters.iter().map(|p| {
            (format!("parameters.{}.value", p.name), p.value, p.value.is_finite(), finite)
        });
        match initial.chain(trusted).chain(values).find(|(_, _, good, _)| !good) {
            Some((what, value, _, rule)) => Err(EquationError::Number { what, value, rule }),
            None => Ok(()),
        }
    }
}

/// Largest number of states, inputs and outputs of a model, of parameters, and of tokens of all its equations: such models simulate in minutes.
pub(super) const MOST_CHANNELS: usize = 1000;

pub(super) const MOST_PARAMETERS: usize = 10_000;

pub(super) const MOST_NODES: usize = 200_000;

/// Refuses a model that is too large, before any work on it.
pub(crate) fn check_sizes(
    inputs: usize,
    states: usize,
    parameters: usize,
    outputs: usize,
) -> Result<(), EquationError> {
    let channels = [("inputs", inputs), ("states", states), ("outputs", outputs)]
        .map(|(what, got)| (what, got, MOST_CHANNELS));
    match channels
        .into_iter()
        .chain([("parameters", parameters, MOST_PARAMETERS)])
        .find(|(_, got, limit)| got > limit)
    {
        Some((what, got, limit)) => Err(EquationError::TooMany { what, got, limit }),
        None => Ok(()),
    }
}

impl Equations {
    /// Checks the names and compiles the equations.
    ///
    /// # Errors
    /// [`EquationError`], which points into the expression or names the conflict.
    pub fn new(
        inputs: Vec<Symbol>,
        states: Vec<StateVariable>,
        parameters: Vec<Parameter>,
        outputs: Vec<OutputVariable>,
    ) -> Result<Self, EquationError> {
        Self::with_definitions(inputs, states, parameters, Vec::new(), outputs)
    }

    /// As [`Self::new`], with named expressions that are available to equations and to later definitions.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_definitions(
        inputs: Vec<Symbol>,
        states: Vec<StateVariable>,
        parameters: Vec<Parameter>,
        definitions: Vec<Definition>,
        outputs: Vec<OutputVariable>,
    ) -> Result<Self, EquationError> {
        check_sizes(inputs.len(), states.len(), parameters.len(), outputs.len())?;
        let names = Names {
            inputs: &inputs,
            states: &states,
            parameters: &parameters,
            definitions: &definitions,
        };
        names.check()?;
        let mut seen = HashSet::new();
        if let Some(twice) = outputs.iter().find(|o| !seen.insert(o.name.as_str())) {
            let (name, first) = (twice.name.clone(), "an output");
            return Err(EquationError::Clash { name, first, second: "another one of that kind" });
        }
        let before = |i: usize| Names { definitions: &definitions[..i], ..names };
        let tree = |table: &str, name: &str, text: &str, names: &Names<'_>| {
            parse(&format!("{table}.{name}"), text, names)
        };
        let definition_trees: Vec<Tree> = (definitions.iter().enumerate())
            .map(|(i, d)| tree("definitions", &d.name, &d.expression, &before(i)))
            .collect::<Result<_, _>>()?;
        let derivative_trees: Vec<Tree> = (states.iter())
            .map(|s| tree("derivatives", &s.name, &s.derivative, &names))
            .collect::<Result<_, _>>()?;
        let output_trees: Vec<Tree> = (outputs.iter())
            .map(|o| tree("output_equations", &o.name, &o.equation, &names))
            .collect::<Result<_, _>>()?;
        let trees = definition_trees.iter().chain(&derivative_trees).chain(&output_trees);
        let (got, limit) = (trees.map(|t| t.nodes.len()).sum(), MOST_NODES);
        if got > limit {
            let what = "numbers, names and operators";
            return Err(EquationError::TooMany { what, got, limit });
        }
        let sizes =
            Sizes { states: states.len(), inputs: inputs.len(), parameters: parameters.len() };
        let derivative_program = Program::compile(&definition_trees, &derivative_trees, sizes);
        let output_program = Program::compile(&definition_trees, &output_trees, sizes);
        let affine = derivative_program.is_affine() && output_program.is_affine();
        Ok(Self {
            inputs,
            states,
            parameters,
            outputs,
            affine,
            definitions,
            definition_trees,
            derivative_trees,
            output_trees,
            derivative_program,
            output_program,
        })
    }

    /// The meaning of names in an expression.
    pub(super) fn names(&self) -> Names<'_> {
        Names {
            inputs: &self.inputs,
            states: &self.states,
            parameters: &self.parameters,
            definitions: &self.definitions,
        }
    }

    /// The inputs, in order.
    #[must_use]
    pub fn input_symbols(&self) -> &[Symbol] {
        &self.inputs
    }

    /// The states, in order.
    #[must_use]
    pub fn state_variables(&self) -> &[StateVariable] {
        &self.states
    }

    /// The parameters, in order.
    #[must_use]
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The outputs, in order.
    #[must_use]
    pub fn output_variables(&self) -> &[OutputVariable] {
        &self.outputs
    }

    /// The definitions, in order.
    #[must_use]
    pub fn definitions(&self) -> &[Definition] {
        &self.definitions
    }

    /// The nominal values of the parameters.
    #[must_use]
    pub fn nominal(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
    }

    /// The state at the start of a log.
    #[must_use]
    pub fn initial(&self) -> Vec<f64> {
        self.states.iter().map(|s| s.initial).collect()
    }

    /// Memory for evaluations of this model.
    #[must_use]
    pub fn workspace(&self) -> Workspace {
        let mut workspace = Workspace::default();
        self.derivative_program.fit(&mut workspace.derivatives);
        self.output_program.fit(&mut workspace.outputs);
        workspace
    }

    /// The numbers of states and inputs. An effect on an internal quantity adds an input.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.states.len(), self.inputs.len())
    }

    fn check_point(&self, at: Point<'_>) {
        debug_assert_eq!(
            (at.x.len(), at.u.len(), at.p.len()),
            (self.states.len(), self.inputs.len(), self.parameters.len())
        );
    }

    /// dx/dt at time `t` (seconds from the log's first sample), states `x`, inputs `u` and parameters `p`. Undefined values are NaN or infinite;
    /// [`Self::explain`] gives the reason.
    #[inline]
    pub fn derivatives(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64],
        p: &[f64],
        workspace: &mut Workspace,
        dx: &mut [f64],
    ) {
        let at = Point { t, x, u, p };
        self.check_point(at);
        self.derivative_program.evaluate(at, &mut workspace.derivatives, dx);
    }

    /// The outputs, as [`Self::derivatives`].
    #[inline]
    pub fn outputs(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64],
        p: &[f64],
        workspace: &mut Workspace,
        y: &mut [f64],
    ) {
        let at = Point { t, x, u, p };
        self.check_point(at);
        self.output_program.evaluate(at, &mut workspace.outputs, y);
    }

    /// Index of the first leaf of a kind after `time`, and their number.
    fn leaves(&self, wrt: Wrt) -> (usize, usize) {
        let (n, m) = (self.states.len(), self.inputs.len());
        match wrt {
            Wrt::States => (1, n),
            Wrt::Inputs => (1 + n, m),
            Wrt::Parameters => (1 + n + m, self.parameters.len()),
        }
    }

    /// Derivatives of dx/dt, column by column: `jacobian[i + n*j]` is that of state i with respect to the j-th of `wrt`.
    #[allow(clippy::too_many_arguments)]
    pub fn derivatives_jacobian(
        &self,
        wrt: Wrt,
        t: f64,
        x: &[f64],
        u: &[f64],
        p: &[f64],
        workspace: &mut Workspace,
        jacobian: &mut [f64],
    ) {
        let at = Point { t, x, u, p };
        self.check_point(at);
        self.derivative_program.differentiate(
            at,
            self.leaves(wrt),
            &mut workspace.derivatives,
            jacobian,
        );
    }

    /// Derivatives of the outputs, column by column: `jacobian[i + outputs*j]` is that of output i with respect to the j-th of `wrt`.
    #[allow(clippy::too_many_arguments)]
    pub fn outputs_jacobian(
        &self,
        wrt: Wrt,
        t: f64,
        x: &[f64],
        u: &[f64],
        p: &[f64],
        workspace: &mut Workspace,
        jacobian: &mut [f64],
    ) {
        let at = Point { t, x, u, p };
        self.check_point(at);
        self.output_program.differentiate(at, self.leaves(wrt), &mut workspace.outputs, jacobian);
    }

    /// dx/dt and its derivatives along directions; `tangents[i*count + j]` is that of state i along direction j. The result is the right-hand side of the
    /// sensitivity equations, at the cost of one evaluation per direction.
    #[allow(clippy::too_many_arguments)]
    pub fn derivatives_along(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64],
        p: &[f64],
        directions: Directions<'_>,
        workspace: &mut Workspace,
        dx: &mut [f64],
        tangents: &mut [f64],
    ) {
        let at = Point { t, x, u, p };
        self.check_point(at);
        self.derivative_program.along(
            at,
            directions.count,
            directions.seeds(),
            &mut workspace.derivatives,
            dx,
            tangents,
        );
    }

    /// The outputs and their derivatives along directions, as [`Self::derivatives_along`].
    #[allow(clippy::too_many_arguments)]
    pub fn outputs_along(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64],
        p: &[f64],
        directions: Directions<'_>,
        workspace: &mut Workspace,
        y: &mut [f64],
        tangents: &mut [f64],
    ) {
        let at = Point { t, x, u, p };
        self.check_point(at);
        self.output_program.along(
            at,
            directions.count,
            directions.seeds(),
            &mut workspace.outputs,
            y,
            tangents,
        );
    }

    /// The equations are affine in states and inputs and independent of `time`. The linear model about any point is then exact.
    #[must_use]
    pub fn is_affine(&self) -> bool {
        self.affine
    }

    /// The linear model about a point (which need not be an equilibrium).
    #[must_use]
    pub fn linearise(&self, t: f64, x: &[f64], u: &[f64], p: &[f64]) -> Matrices {
        let mut workspace = self.workspace();
        let (n, m, outputs) = (self.states.len(), self.inputs.len(), self.outputs.len());
        let [mut a, mut b] = [DMatrix::zeros(n, n), DMatrix::zeros(n, m)];
        let [mut c, mut d] = [DMatrix::zeros(outputs, n), DMatrix::zeros(outputs, m)];
        self.derivatives_jacobian(Wrt::States, t, x, u, p, &mut workspace, a.as_mut_slice());
        self.derivatives_jacobian(Wrt::Inputs, t, x, u, p, &mut workspace, b.as_mut_slice());
        self.outputs_jacobian(Wrt::States, t, x, u, p, &mut workspace, c.as_mut_slice());
        self.outputs_jacobian(Wrt::Inputs, t, x, u, p, &mut workspace, d.as_mut_slice());
        Matrices { a, b, c, d }
    }

    /// Whether the derivative of a state depends on the j-th of `wrt`.
    #[must_use]
    pub fn derivative_depends(&self, state: usize, wrt: Wrt, j: usize) -> bool {
        let (first, count) = self.leaves(wrt);
        j < count && self.derivative_program.depends(state, first + j)
    }

    /// Operations of one evaluation of the derivatives and of the outputs, without those on parameters alone.
    #[must_use]
    pub fn operations(&self) -> (usize, usize) {
        (self.derivative_program.len(), self.output_program.len())
    }

    /// The equation, and the part of it, that is undefined at a point; `None` where all values are finite.
    #[must_use]
    pub fn explain(&self, t: f64, x: &[f64], u: &[f64], p: &[f64]) -> Option<NonFinite> {
        let at = Point { t, x, u, p };
        let mut defined: Vec<f64> = Vec::with_capacity(self.definitions.len());
        for (tree, definition) in self.definition_trees.iter().zip(&self.definitions) {
            // An undefined value in a definition is reported there, not at the use of the definition.
            if let Some(found) =
                explain::explain(&format!("definitions.{}", definition.name), tree, &defined, at)
            {
                return Some(found);
            }
            defined.push(explain::values(tree, &defined, at).last().copied().unwrap_or(f64::NAN));
        }
        let derivatives =
            self.derivative_trees.iter().zip(self.states.iter().map(|s| ("derivatives", &s.name)));
        let outputs = self
            .output_trees
            .iter()
            .zip(self.outputs.iter().map(|o| ("output_equations", &o.name)));
        derivatives.chain(outputs).find_map(|(tree, (table, name))| {
            explain::explain(&format!("{table}.{name}"), tree, &defined, at)
        })
    }
}
