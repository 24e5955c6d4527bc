//! The step of a nonlinear system: equations, or a linear model with friction or another nonlinear term.

use super::assembly::Assembly;
use super::error::SimulateError;
use super::field::{Driven, Field, Plant, sign};
use super::history::{Histories, NODES};
use super::piecewise::Piece;
use super::plan::Term;
use super::simulator::Port;
use super::walk::{Drive, Stepper};
use crate::simulate::ode::integrator::Integrator;

/// Changes between sticking and sliding within one step before the simulation fails.
const CHANGES: usize = 1000;

/// A nonlinear system during its simulation.
pub(super) struct Nonlinear<'a> {
    field: Field<'a>,
    /// A second field, for monitoring contacts while the first is integrated.
    watch: Field<'a>,
    /// The field from every switch on.
    later: Vec<Field<'a>>,
    integrator: Integrator,
    /// The drive with delayed quantities; without pieces where there are none.
    own: Drive,
    /// The signals' pieces of the last step.
    pieces: Vec<Piece>,
    x: Vec<f64>,
    dx: Vec<f64>,
}

impl<'a> Nonlinear<'a> {
    /// The system at the start and from every switch on, each with its equations.
    pub(super) fn new(
        (assembly, equations): (&Assembly, Option<Plant<'a>>),
        later: impl Iterator<Item = (&'a Assembly, Option<Plant<'a>>)>,
        terms: &'a [Term],
        integrator: Integrator,
    ) -> Self {
        let field = || Field::new(assembly, equations, terms);
        let later =
            later.map(|(assembly, equations)| Field::new(assembly, equations, terms)).collect();
        let (x, dx) = (assembly.start.clone(), vec![0.0; assembly.states]);
        let own = Drive { pieces: Vec::new(), alone_until_s: None, late: assembly.late.clone() };
        let (field, watch, pieces) = (field(), field(), Vec::new());
        Self { field, watch, later, integrator, own, pieces, x, dx }
    }

    /// An error of too stiff equations, with the name of the state responsible.
    pub(super) fn blame(&self, error: SimulateError, states: &[Port]) -> SimulateError {
        match (error, self.integrator.fastest()) {
            (SimulateError::Stiff { time_s, steps, .. }, Some((state, time_constant_s))) => {
                let state = states
                    .get(state)
                    .map_or_else(|| "lag or mode of an effect".to_owned(), |s| s.name.clone());
                SimulateError::TooFast { state, time_constant_s, time_s, steps }
            }
            (error, _) => error,
        }
    }

    /// A zero velocity sticks if friction can hold it; all others slide in their direction.
    fn settle_contacts(&mut self, t: f64, drive: &Drive) {
        for i in 0..self.field.contacts.len() {
            let state = self.field.contacts[i].state;
            self.field.contacts[i].direction = sign(self.x[state]);
        }
        self.field.eval(t, &self.x, &mut self.dx, drive);
        for i in 0..self.field.contacts.len() {
            let contact = &mut self.field.contacts[i];
            if self.x[contact.state] == 0.0 {
                contact.direction =
                    if contact.rest.abs() <= contact.level { 0.0 } else { sign(contact.rest) };
            }
        }
    }

    fn advance_with_contacts(
        &mut self,
        from_s: f64,
        to_s: f64,
        drive: &Drive,
    ) -> Result<(), SimulateError> {
        let mut now = from_s;
        self.settle_contacts(now, drive);
        for _ in 0..CHANGES {
            self.watch.contacts.clone_from(&self.field.contacts);
            let (watch, dx) = (&mut self.watch, &mut self.dx);
            // Positive until a contact changes.
            let mut margin = |t: f64, x: &[f64]| {
                if watch.contacts.iter().any(|c| c.direction == 0.0) {
                    watch.eval(t, x, dx, drive);
                }
                watch.contacts.iter().map(|c| c.margin(x)).fold(f64::INFINITY, f64::min)
            };
            let mut driven = Driven { field: &mut self.field, drive };
            let Some(at) =
                self.integrator.advance_until(&mut driven, now, to_s, &mut self.x, &mut margin)?
            else {
                return Ok(());
            };
            now = at;
            // The changing contact is the one whose margin is zero.
            self.field.eval(now, &self.x, &mut self.dx, drive);
            let gone = self
                .field
                .contacts
                .iter()
                .min_by(|a, b| a.margin(&self.x).total_cmp(&b.margin(&self.x)))
                .map(|c| (c.state, c.direction));
            let Some((state, direction)) = gone else { return Ok(()) };
            if direction != 0.0 {
                self.x[state] = 0.0;
                self.settle_contacts(now, drive);
            } else if let Some(contact) = self.field.contacts.iter_mut().find(|c| c.state == state)
            {
                contact.direction = sign(contact.rest);
            }
            if now >= to_s {
                return Ok(());
            }
        }
        Err(SimulateError::Contacts { time_s: now })
    }
}

impl Nonlinear<'_> {
    /// The same with delayed quantities: stretch by stretch with all of them known, and within each from node to node of its curves.
    fn advance_late(
        &mut self,
        from_s: f64,
        to_s: f64,
        own: &mut Drive,
    ) -> Result<(), SimulateError> {
        let mut values = vec![[0.0; NODES.len()]; own.late.quantities.len()];
        own.late.edge(from_s);
        let mut now = from_s;
        while now < to_s {
            let next = own.late.next(now, to_s);
            // Delayed values may jump here.
            self.pieces.clear();
            self.field.begin(now, own);
            self.field.raw(now, &self.x, own, 0, &mut values);
            // The step budget excludes the additional steps of a dead time.
            self.integrator.budget = self.integrator.budget.saturating_add(NODES.len());
            for node in 1..NODES.len() {
                let [begin, end] = [node - 1, node].map(|i| now + NODES[i] * (next - now));
                self.advance_known(begin, end, own)?;
                self.field.raw(end, &self.x, own, node, &mut values);
            }
            own.late.push((now, next), &values);
            now = next;
        }
        Ok(())
    }

    /// With all signals known over the interval.
    fn advance_known(
        &mut self,
        from_s: f64,
        to_s: f64,
        drive: &Drive,
    ) -> Result<(), SimulateError> {
        self.field.begin(from_s, drive);
        let moved = if self.field.contacts.is_empty() {
            if self.pieces == drive.pieces {
                self.integrator.same_right_hand_side();
            } else {
                self.pieces.clone_from(&drive.pieces);
            }
            let mut driven = Driven { field: &mut self.field, drive };
            match drive.alone_until_s {
                Some(until_s) => {
                    self.integrator.advance_past(&mut driven, (from_s, to_s), until_s, &mut self.x)
                }
                None => self.integrator.advance(&mut driven, from_s, to_s, &mut self.x),
            }
        } else {
            self.watch.begin(from_s, drive);
            self.advance_with_contacts(from_s, to_s, drive)
        };
        match (moved, self.integrator.breakdown()) {
            (Err(SimulateError::Undefined { time_s }), Some((t, x))) => {
                Err(self.field.explain(t, x, drive).unwrap_or(SimulateError::Undefined { time_s }))
            }
            (moved, _) => moved,
        }
    }
}

impl Stepper for Nonlinear<'_> {
    fn advance(&mut self, from_s: f64, to_s: f64, drive: &Drive) -> Result<(), SimulateError> {
        if self.own.late.quantities.is_empty() {
            return self.advance_known(from_s, to_s, drive);
        }
        let mut own = std::mem::take(&mut self.own);
        own.pieces.clone_from(&drive.pieces);
        let moved = self.advance_late(from_s, to_s, &mut own);
        self.own = own;
        moved
    }

    fn outputs(&mut self, at_s: f64, drive: &Drive, y: &mut [f64]) -> Result<(), SimulateError> {
        if self.own.late.quantities.is_empty() {
            return self.field.read(at_s, &self.x, y, drive);
        }
        self.own.pieces.clone_from(&drive.pieces);
        self.own.late.arrive(at_s);
        self.field.read(at_s, &self.x, y, &self.own)
    }

    fn histories(&mut self) -> Option<&mut Histories> {
        Some(&mut self.own.late).filter(|late| !late.quantities.is_empty())
    }

    fn switch(&mut self, number: usize) {
        let Some(later) = self.later.get(number) else { return };
        for field in [&mut self.field, &mut self.watch] {
            field.becomes(later);
        }
        // Another right-hand side, with any pieces.
        self.pieces.clear();
    }

    fn whole_state(&mut self) -> &mut [f64] {
        &mut self.x
    }

    fn plant_state(&mut self) -> &mut [f64] {
        &mut self.x[..self.field.plant]
    }

    fn steps(&self) -> usize {
        let (made, again) = self.integrator.steps();
        made + again
    }
}
