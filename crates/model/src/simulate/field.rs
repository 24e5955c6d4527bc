//! The right-hand side of a nonlinear system: all terms of a derivative, and its Jacobian.

use super::assembly::Assembly;
use super::error::SimulateError;
use super::plan::Term;
use super::walk::Drive;
use crate::equations::system::{Equations, Workspace, Wrt};
use crate::simulate::ode::rhs::Rhs;

/// A coefficient of a row: (row, column, value).
type Entry = (usize, usize, f64);

/// The nonzero coefficients of rows.
fn entries(rows: &[Vec<f64>]) -> Vec<Entry> {
    let of_row = |(i, row): (usize, &Vec<f64>)| {
        row.iter()
            .enumerate()
            .filter(|(_, v)| **v != 0.0)
            .map(|(j, v)| (i, j, *v))
            .collect::<Vec<_>>()
    };
    rows.iter().enumerate().flat_map(of_row).collect()
}

/// The present friction on one state; levels of several terms add up.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact {
    pub(super) state: usize,
    pub(super) level: f64,
    /// The sign of the velocity; 0: sticking.
    pub(super) direction: f64,
    /// The derivative of the velocity without this friction, at the last evaluation.
    pub(super) rest: f64,
}

impl Contact {
    /// Positive until the contact changes between sticking and sliding.
    pub(super) fn margin(&self, x: &[f64]) -> f64 {
        if self.direction == 0.0 {
            self.level - self.rest.abs()
        } else {
            self.direction * x[self.state]
        }
    }
}

/// A state of hysteresis, driven by a velocity.
#[derive(Debug, Clone, Copy)]
struct HysteresisState {
    state: usize,
    velocity: usize,
    displacement: f64,
    sharpness: f64,
}

impl HysteresisState {
    /// The share of the slope before the force saturates: 1 on the way back.
    fn open(&self, x: &[f64]) -> f64 {
        let z = x[self.state];
        if z * x[self.velocity] > 0.0 { 1.0 - z.abs().powf(self.sharpness) } else { 1.0 }
    }

    fn derivative(&self, x: &[f64]) -> f64 {
        x[self.velocity] / self.displacement * self.open(x)
    }

    /// The derivatives by the velocity and by the hysteresis state itself.
    fn slopes(&self, x: &[f64]) -> [f64; 2] {
        let (z, v) = (x[self.state], x[self.velocity]);
        let closing = if z * v > 0.0 {
            self.sharpness * z.abs().powf(self.sharpness - 1.0) * v.abs() / self.displacement
        } else {
            0.0
        };
        [self.open(x) / self.displacement, -closing]
    }
}

/// −1, 0 or 1.
pub(super) fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// The nonlinear plant: equations and their parameters.
pub(super) type Plant<'a> = (&'a Equations, &'a [f64]);

/// The right-hand side.
pub(super) struct Field<'a> {
    pub(super) plant: usize,
    /// Index of the constant 1.
    one: usize,
    states: usize,
    equations: Option<(&'a Equations, &'a [f64], Workspace)>,
    terms: &'a [Term],
    inputs: Vec<Entry>,
    derivatives: Vec<Entry>,
    outputs: Vec<Entry>,
    /// Delayed quantities before their delay.
    raw: Vec<Entry>,
    /// A derivative depends on an output of the plant: a sensor's lag.
    senses: bool,
    /// No state lies between the signals and the plant.
    direct: bool,
    /// All signals are constant until the next edge.
    held: bool,
    /// The factors of the rows: states, signals, 1, the plant's outputs.
    now: Vec<f64>,
    /// The plant's input.
    received: Vec<f64>,
    pub(super) contacts: Vec<Contact>,
    memories: Vec<HysteresisState>,
    /// By columns: the plant's Jacobians by its inputs, and those of its outputs by states and inputs.
    blocks: [Vec<f64>; 4],
}

impl<'a> Field<'a> {
    pub(super) fn new(
        assembly: &Assembly,
        equations: Option<Plant<'a>>,
        terms: &'a [Term],
    ) -> Self {
        let one = assembly.states + assembly.signals;
        let (n, m, p) = (assembly.plant, assembly.inputs.len(), assembly.own);
        let mut now = vec![0.0; one + 1 + p];
        now[one] = 1.0;
        let mut contacts: Vec<Contact> = Vec::new();
        for term in terms {
            let Term::Friction { state, level } = *term else { continue };
            match contacts.iter_mut().find(|c| c.state == state) {
                Some(contact) => contact.level += level,
                None => contacts.push(Contact {
                    state,
                    level,
                    direction: sign(assembly.start[state]),
                    rest: 0.0,
                }),
            }
        }
        let memory = |term: &Term| match *term {
            Term::Hysteresis { velocity, displacement, sharpness, .. } => {
                Some((velocity, displacement, sharpness))
            }
            _ => None,
        };
        let memories = (terms.iter().filter_map(memory).zip(&assembly.memories))
            .map(|((velocity, displacement, sharpness), &state)| HysteresisState {
                state,
                velocity,
                displacement,
                sharpness,
            })
            .collect();
        let (inputs, derivatives) = (entries(&assembly.inputs), entries(&assembly.derivatives));
        let size = if equations.is_some() { [n * n, n * m, p * n, p * m] } else { [0; 4] };
        Self {
            plant: n,
            one,
            states: assembly.states,
            equations: equations.map(|(e, p)| (e, p, e.workspace())),
            terms,
            senses: derivatives.iter().any(|&(_, j, _)| j > one),
            direct: inputs.iter().all(|&(_, j, _)| j >= assembly.states),
            held: false,
            inputs,
            derivatives,
            outputs: entries(&assembly.outputs),
            raw: entries(&assembly.raw),
            now,
            received: vec![0.0; m],
            contacts,
            memories,
            blocks: size.map(|length| vec![0.0; length]),
        }
    }

    /// Replaces the system by another field from now on; the state remains.
    pub(super) fn becomes(&mut self, later: &Self) {
        if let (Some(own), Some((equations, parameters, _))) =
            (&mut self.equations, &later.equations)
        {
            (own.0, own.1) = (equations, parameters);
        }
        self.inputs.clone_from(&later.inputs);
        self.derivatives.clone_from(&later.derivatives);
        self.outputs.clone_from(&later.outputs);
        self.raw.clone_from(&later.raw);
        (self.senses, self.direct) = (later.senses, later.direct);
    }

    /// Stores the signals' pieces; must precede any evaluation on them.
    pub(super) fn begin(&mut self, t: f64, drive: &Drive) {
        let late = drive.late.quantities.is_empty();
        self.held = late && drive.pieces.iter().all(|piece| piece.slope == 0.0);
        self.signals(t, drive);
        self.receive();
    }

    fn signals(&mut self, t: f64, drive: &Drive) {
        let commands = drive.pieces.iter().map(|piece| piece.at(t));
        let late = drive.late.quantities.iter().map(|quantity| quantity.late(t));
        for (to, value) in self.now[self.states..self.one].iter_mut().zip(commands.chain(late)) {
            *to = value;
        }
    }

    fn receive(&mut self) {
        if self.equations.is_some() {
            self.received.fill(0.0);
            for &(i, j, value) in &self.inputs {
                self.received[i] += value * self.now[j];
            }
        }
    }

    /// Computes everything up to the plant's outputs.
    #[inline]
    fn fill(&mut self, t: f64, x: &[f64], drive: &Drive) {
        self.now[..self.states].copy_from_slice(x);
        if !self.held {
            self.signals(t, drive);
        }
        if !(self.held && self.direct) {
            self.receive();
        }
    }

    /// Computes the plant's outputs.
    fn sense(&mut self, t: f64) {
        if let Some((equations, parameters, workspace)) = &mut self.equations {
            let (before, own) = self.now.split_at_mut(self.one + 1);
            equations.outputs(t, &before[..self.plant], &self.received, parameters, workspace, own);
        }
    }

    #[inline]
    pub(super) fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64], drive: &Drive) {
        // Equations alone on constant inputs need no rows.
        if !(self.held && self.direct && self.derivatives.is_empty()) {
            self.fill(t, x, drive);
        }
        match &mut self.equations {
            Some((equations, parameters, workspace)) => {
                let (plant, added) = dx.split_at_mut(self.plant);
                equations.derivatives(
                    t,
                    &x[..self.plant],
                    &self.received,
                    parameters,
                    workspace,
                    plant,
                );
                added.fill(0.0);
            }
            None => dx.fill(0.0),
        }
        if self.senses {
            self.sense(t);
        }
        for &(i, j, value) in &self.derivatives {
            dx[i] += value * self.now[j];
        }
        for term in self.terms {
            if let Term::Function { to, from, f } = term {
                dx[*to] += f(x[*from]);
            }
        }
        for memory in &self.memories {
            dx[memory.state] = memory.derivative(x);
        }
        for contact in &mut self.contacts {
            contact.rest = dx[contact.state];
            dx[contact.state] = if contact.direction == 0.0 {
                0.0
            } else {
                contact.rest - contact.level * contact.direction
            };
        }
    }

    /// The outputs at the sensors.
    ///
    /// # Errors
    /// [`SimulateError::Equation`] for an output without a finite value.
    pub(super) fn read(
        &mut self,
        t: f64,
        x: &[f64],
        y: &mut [f64],
        drive: &Drive,
    ) -> Result<(), SimulateError> {
        self.begin(t, drive);
        self.fill(t, x, drive);
        self.sense(t);
        if let Some((equations, parameters, _)) = &self.equations
            && !self.now[self.one + 1..].iter().all(|v| v.is_finite())
            && let Some(why) = equations.explain(t, &x[..self.plant], &self.received, parameters)
        {
            return Err(SimulateError::Equation(why));
        }
        y.fill(0.0);
        for &(i, j, value) in &self.outputs {
            y[i] += value * self.now[j];
        }
        Ok(())
    }

    /// The delayed quantities before their delay.
    pub(super) fn raw(
        &mut self,
        t: f64,
        x: &[f64],
        drive: &Drive,
        node: usize,
        to: &mut [[f64; 5]],
    ) {
        self.fill(t, x, drive);
        self.sense(t);
        to.iter_mut().for_each(|values| values[node] = 0.0);
        for &(i, j, value) in &self.raw {
            to[i][node] += value * self.now[j];
        }
    }

    /// The equation responsible for a derivative that is not finite, if one is.
    pub(super) fn explain(&mut self, t: f64, x: &[f64], drive: &Drive) -> Option<SimulateError> {
        self.fill(t, x, drive);
        let (equations, parameters, _) = self.equations.as_ref()?;
        equations
            .explain(t, &x[..self.plant], &self.received, parameters)
            .map(SimulateError::Equation)
    }

    /// ∂(dx)/∂x by columns: exact, except for functions of one state.
    fn jacobian(&mut self, t: f64, x: &[f64], jacobian: &mut [f64], drive: &Drive) {
        let size = self.states;
        self.fill(t, x, drive);
        jacobian.fill(0.0);
        self.plant_jacobian(t, x, jacobian);
        for &(i, j, value) in self.derivatives.iter().filter(|(_, j, _)| *j < size) {
            jacobian[i + size * j] += value;
        }
        for term in self.terms {
            if let Term::Function { to, from, f } = term {
                let h = f64::EPSILON.cbrt() * x[*from].abs().max(1e-3);
                jacobian[to + size * from] += (f(x[*from] + h) - f(x[*from] - h)) / (2.0 * h);
            }
        }
        for memory in &self.memories {
            let [by_velocity, by_itself] = memory.slopes(x);
            jacobian[memory.state + size * memory.velocity] += by_velocity;
            jacobian[memory.state + size * memory.state] += by_itself;
        }
        for contact in self.contacts.iter().filter(|c| c.direction == 0.0) {
            for j in 0..size {
                jacobian[contact.state + size * j] = 0.0;
            }
        }
    }

    /// Adds the equations' part: their own, through feedback to their inputs, and through lags of sensors.
    fn plant_jacobian(&mut self, t: f64, x: &[f64], jacobian: &mut [f64]) {
        let (size, n) = (self.states, self.plant);
        let Some((equations, p, workspace)) = &mut self.equations else { return };
        let [by_states, by_inputs, own_by_states, own_by_inputs] = &mut self.blocks;
        let (x, u) = (&x[..n], self.received.as_slice());
        // Rows of inputs with a coefficient on a state.
        let fed_back = || self.inputs.iter().filter(|(_, j, _)| *j < size);
        equations.derivatives_jacobian(Wrt::States, t, x, u, p, workspace, by_states);
        for j in 0..n {
            jacobian[size * j..size * j + n].copy_from_slice(&by_states[n * j..n * (j + 1)]);
        }
        if !self.direct {
            equations.derivatives_jacobian(Wrt::Inputs, t, x, u, p, workspace, by_inputs);
            for &(input, j, value) in fed_back() {
                for i in 0..n {
                    jacobian[i + size * j] += by_inputs[i + n * input] * value;
                }
            }
        }
        if !self.senses {
            return;
        }
        let own = self.now.len() - self.one - 1;
        equations.outputs_jacobian(Wrt::States, t, x, u, p, workspace, own_by_states);
        equations.outputs_jacobian(Wrt::Inputs, t, x, u, p, workspace, own_by_inputs);
        for &(i, from, value) in self.derivatives.iter().filter(|(_, j, _)| *j > self.one) {
            let output = from - self.one - 1;
            for j in 0..n {
                jacobian[i + size * j] += value * own_by_states[output + own * j];
            }
            for &(input, j, gain) in fed_back() {
                jacobian[i + size * j] += value * own_by_inputs[output + own * input] * gain;
            }
        }
    }
}

/// A field on a drive, in the integrator's interface.
pub(super) struct Driven<'f, 'a> {
    pub(super) field: &'f mut Field<'a>,
    pub(super) drive: &'f Drive,
}

impl Rhs for Driven<'_, '_> {
    fn dim(&self) -> usize {
        self.field.states
    }

    #[inline]
    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
        self.field.eval(t, x, dx, self.drive);
    }

    fn jacobian(
        &mut self,
        t: f64,
        x: &mut [f64],
        _dx: &[f64],
        _scratch: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.field.jacobian(t, x, jacobian, self.drive);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::applied::{Applied, Chance};
    use crate::effect::effects::find;
    use crate::file::document::ModelDocument;
    use crate::simulate::assembly::InnerDelays;
    use crate::simulate::history::Histories;
    use crate::simulate::piecewise::Piece;
    use crate::simulate::system::{Dynamics, System};

    const PENDULUM: &str = r#"
format = "deadtime/model@1"
name = "pendulum"
kind = "equations"
inputs = [{ name = "u" }, { name = "w" }]
outputs = [{ name = "y" }, { name = "z" }]
[states]
angle = { initial = 0.3 }
rate = { initial = -0.1 }
[parameters]
k = { value = 0.2 }
[derivatives]
angle = "rate + 0.1*w^2"
rate = "u*cos(angle) - k*rate*abs(rate) - 9*sin(angle)"
[output_equations]
y = "sin(angle)*w"
z = "rate^2 + u*angle"
"#;

    /// The same right-hand side with Jacobians by differences.
    struct Plain<'f, 'a>(Driven<'f, 'a>);

    impl Rhs for Plain<'_, '_> {
        fn dim(&self) -> usize {
            self.0.dim()
        }

        fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
            self.0.eval(t, x, dx);
        }
    }

    #[test]
    fn the_jacobian_is_that_of_the_right_hand_side_with_all_that_is_added_to_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        std::fs::write(&path, PENDULUM).unwrap();
        let system = System::new(&ModelDocument::read(&path).unwrap(), |_| Ok(0.0)).unwrap();
        let effect = |name: &str, channel: &str, values: &[f64]| {
            let mut applied = Applied::nominal(&system, find(name).unwrap(), channel).unwrap();
            applied.values.copy_from_slice(values);
            applied
        };
        let effects = [
            effect("actuator_lag", "u", &[0.2]),
            effect("unmodelled_mode", "w->input:w", &[1.3, 0.2, 0.4]),
            effect("unmodelled_mode", "u->state:angle", &[0.7, 0.1, 0.3]),
            effect("cross_coupling", "w->rate", &[0.6]),
            effect("cubic_stiffness", "angle->rate", &[2.0]),
            effect("misalignment", "y->z", &[0.3]),
            effect("sensor_lag", "z", &[0.4]),
            effect("coulomb_friction", "rate", &[0.1]),
            effect("hysteresis", "rate", &[0.4, 0.3, 1.7]),
        ];
        let plan = Applied::plan(&system, &effects, Chance::Mean).unwrap();
        let Dynamics::Equations(equations, parameters) = &plan.dynamics else { panic!("linear") };
        let start = (system.initial.as_slice(), [0.5, -0.7].as_slice());
        let assembly =
            Assembly::new(&system, (&plan, None), InnerDelays::Pade, start, |_| vec![0.1, 0.2]);
        let mut field =
            Field::new(&assembly, Some((equations.as_ref(), parameters.as_slice())), &plan.terms);
        let pieces = vec![
            Piece { start_s: 0.0, value: 0.5, slope: 0.3 },
            Piece { start_s: 0.0, value: -0.7, slope: 0.0 },
        ];
        let drive = Drive { pieces, alone_until_s: None, late: Histories::default() };
        field.begin(0.4, &drive);
        let n = assembly.states;
        let mut x: Vec<f64> =
            (0..n).map(|i| 0.4 - 0.23 * f64::from(u32::try_from(i).unwrap())).collect();
        for direction in [1.0, 0.0] {
            field.contacts[0].direction = direction;
            let (mut dx, mut scratch, mut exact, mut differences) =
                (vec![0.0; n], vec![0.0; 2 * n], vec![0.0; n * n], vec![0.0; n * n]);
            field.eval(0.4, &x, &mut dx, &drive);
            let mut driven = Driven { field: &mut field, drive: &drive };
            driven.jacobian(0.4, &mut x, &dx, &mut scratch, &mut exact);
            Plain(driven).jacobian(0.4, &mut x, &dx, &mut scratch, &mut differences);
            assert!(exact.iter().filter(|v| **v != 0.0).count() > n, "{exact:?}");
            for (at, (a, b)) in exact.iter().zip(&differences).enumerate() {
                assert!(
                    (a - b).abs() < 1e-5 * (1.0 + a.abs()),
                    "row {} column {}: {a} and {b}",
                    at % n,
                    at / n
                );
            }
        }
    }
}
