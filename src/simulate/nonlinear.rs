//! The step of a nonlinear system: equations, or a linear model with friction or another nonlinear term.

use super::SimulateError;
use super::assembly::Assembly;
use super::ode::{Integrator, Rhs};
use super::plan::Term;
use super::walk::{Drive, Stepper};
use crate::model::{Equations, Workspace};

/// Changes between sticking and sliding within one step before the simulation gives up.
const CHANGES: usize = 1000;

/// The nonzero coefficients of rows: (row, column, value).
fn entries(rows: &[Vec<f64>]) -> Vec<(usize, usize, f64)> {
    let of_row =
        |(i, row): (usize, &Vec<f64>)| row.iter().enumerate().filter(|(_, v)| **v != 0.0).map(|(j, v)| (i, j, *v)).collect::<Vec<_>>();
    rows.iter().enumerate().flat_map(of_row).collect()
}

/// One friction term as it stands.
#[derive(Debug, Clone, Copy)]
struct Contact {
    state: usize,
    level: f64,
    /// The sign of the velocity; 0: it sticks.
    direction: f64,
    /// The derivative of the velocity without this friction, at the last evaluation.
    rest: f64,
}

/// The right-hand side: everything that a derivative is made of.
struct Field<'a> {
    plant: usize,
    /// Where the constant 1 stands.
    one: usize,
    states: usize,
    equations: Option<(&'a Equations, &'a [f64], Workspace)>,
    terms: &'a [Term],
    inputs: Vec<(usize, usize, f64)>,
    derivatives: Vec<(usize, usize, f64)>,
    outputs: Vec<(usize, usize, f64)>,
    /// A derivative depends on an output of the plant: a sensor's lag.
    senses: bool,
    /// What the rows multiply: states, signals, 1, the plant's outputs.
    now: Vec<f64>,
    /// What the plant receives.
    received: Vec<f64>,
    contacts: Vec<Contact>,
}

impl Field<'_> {
    /// Fills in everything up to the plant's outputs.
    fn fill(&mut self, t: f64, x: &[f64], drive: &Drive) {
        self.now[..self.states].copy_from_slice(x);
        for (to, piece) in self.now[self.states..self.one].iter_mut().zip(&drive.pieces) {
            *to = piece.at(t);
        }
        if self.equations.is_some() {
            self.received.fill(0.0);
            for &(i, j, value) in &self.inputs {
                self.received[i] += value * self.now[j];
            }
        }
    }

    fn sense(&mut self, t: f64) {
        if let Some((equations, parameters, workspace)) = &mut self.equations {
            let (before, own) = self.now.split_at_mut(self.one + 1);
            equations.outputs(t, &before[..self.plant], &self.received, parameters, workspace, own);
        }
    }

    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64], drive: &Drive) {
        self.fill(t, x, drive);
        dx.fill(0.0);
        if let Some((equations, parameters, workspace)) = &mut self.equations {
            equations.derivatives(t, &x[..self.plant], &self.received, parameters, workspace, &mut dx[..self.plant]);
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
        for contact in &mut self.contacts {
            contact.rest = dx[contact.state];
            dx[contact.state] = if contact.direction == 0.0 { 0.0 } else { contact.rest - contact.level * contact.direction };
        }
    }
}

/// A field on a drive, as the integrator wants it.
struct Driven<'f, 'a> {
    field: &'f mut Field<'a>,
    drive: &'f Drive,
}

impl Rhs for Driven<'_, '_> {
    fn dim(&self) -> usize {
        self.field.states
    }

    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]) {
        self.field.eval(t, x, dx, self.drive);
    }
}

/// A nonlinear system on its way through time.
pub(super) struct Nonlinear<'a> {
    field: Field<'a>,
    /// A second field, on which contacts are watched while the first is being integrated.
    watch: Field<'a>,
    integrator: Integrator,
    x: Vec<f64>,
    dx: Vec<f64>,
}

impl<'a> Nonlinear<'a> {
    pub(super) fn new(
        assembly: &Assembly,
        equations: Option<(&'a Equations, &'a [f64])>,
        terms: &'a [Term],
        integrator: Integrator,
    ) -> Self {
        let one = assembly.states + assembly.signals;
        let width = one + 1 + assembly.outputs.len();
        let derivatives = entries(&assembly.derivatives);
        let senses = derivatives.iter().any(|&(_, j, _)| j > one);
        let contacts: Vec<Contact> = terms
            .iter()
            .filter_map(|term| match *term {
                Term::Friction { state, level } => Some(Contact { state, level, direction: sign(assembly.start[state]), rest: 0.0 }),
                _ => None,
            })
            .collect();
        let field = || {
            let mut now = vec![0.0; width];
            now[one] = 1.0;
            Field {
                plant: assembly.plant,
                one,
                states: assembly.states,
                equations: equations.map(|(e, p)| (e, p, e.workspace())),
                terms,
                inputs: entries(&assembly.inputs),
                derivatives: derivatives.clone(),
                outputs: entries(&assembly.outputs),
                senses,
                now,
                received: vec![0.0; assembly.signals],
                contacts: contacts.clone(),
            }
        };
        Self { field: field(), watch: field(), integrator, x: assembly.start.clone(), dx: vec![0.0; assembly.states] }
    }

    /// A velocity of 0 sticks if friction can hold it; all others slide the way they go.
    fn settle_contacts(&mut self, t: f64, drive: &Drive) {
        for i in 0..self.field.contacts.len() {
            let state = self.field.contacts[i].state;
            self.field.contacts[i].direction = sign(self.x[state]);
        }
        self.field.eval(t, &self.x, &mut self.dx, drive);
        for i in 0..self.field.contacts.len() {
            let contact = &mut self.field.contacts[i];
            if self.x[contact.state] == 0.0 {
                contact.direction = if contact.rest.abs() <= contact.level { 0.0 } else { sign(contact.rest) };
            }
        }
    }

    fn advance_with_contacts(&mut self, from_s: f64, to_s: f64, drive: &Drive) -> Result<(), SimulateError> {
        let mut now = from_s;
        self.settle_contacts(now, drive);
        for _ in 0..CHANGES {
            self.watch.contacts.clone_from(&self.field.contacts);
            let (watch, dx) = (&mut self.watch, &mut self.dx);
            // Above 0 while every contact stays what it is.
            let mut margin = |t: f64, x: &[f64]| {
                if watch.contacts.iter().any(|c| c.direction == 0.0) {
                    watch.eval(t, x, dx, drive);
                }
                watch.contacts.iter().map(|c| c.margin(x)).fold(f64::INFINITY, f64::min)
            };
            let mut driven = Driven { field: &mut self.field, drive };
            let Some(at) = self.integrator.advance_until(&mut driven, now, to_s, &mut self.x, &mut margin)? else { return Ok(()) };
            now = at;
            // The contact that changes is the one whose margin is gone.
            self.field.eval(now, &self.x, &mut self.dx, drive);
            let gone =
                self.field.contacts.iter().min_by(|a, b| a.margin(&self.x).total_cmp(&b.margin(&self.x))).map(|c| (c.state, c.direction));
            let Some((state, direction)) = gone else { return Ok(()) };
            if direction != 0.0 {
                self.x[state] = 0.0;
                self.settle_contacts(now, drive);
            } else if let Some(contact) = self.field.contacts.iter_mut().find(|c| c.state == state) {
                contact.direction = sign(contact.rest);
            }
            if now >= to_s {
                return Ok(());
            }
        }
        Err(SimulateError::Contacts { time_s: now })
    }
}

impl Contact {
    fn margin(&self, x: &[f64]) -> f64 {
        if self.direction == 0.0 { self.level - self.rest.abs() } else { self.direction * x[self.state] }
    }
}

/// −1, 0 or 1.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

impl Stepper for Nonlinear<'_> {
    fn advance(&mut self, from_s: f64, to_s: f64, drive: &Drive) -> Result<(), SimulateError> {
        if self.field.contacts.is_empty() {
            let mut driven = Driven { field: &mut self.field, drive };
            return self.integrator.advance(&mut driven, from_s, to_s, &mut self.x);
        }
        self.advance_with_contacts(from_s, to_s, drive)
    }

    fn outputs(&mut self, at_s: f64, drive: &Drive, y: &mut [f64]) -> Result<(), SimulateError> {
        self.field.fill(at_s, &self.x, drive);
        self.field.sense(at_s);
        y.fill(0.0);
        for &(i, j, value) in &self.field.outputs {
            y[i] += value * self.field.now[j];
        }
        Ok(())
    }

    fn plant_state(&mut self) -> &mut [f64] {
        &mut self.x[..self.field.plant]
    }
}
