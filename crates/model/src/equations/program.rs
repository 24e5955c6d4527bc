//! Expressions compiled to a flat list of operations on registers, with constant folding and common subexpressions.
//!
//! Registers: constants, time, states, inputs, parameters, then one for each operation. Operations on parameters and constants alone come first and are
//! recomputed only when a parameter has changed.

use std::collections::HashMap;
use std::hash::{Hash, Hasher};

use super::function::Operation;
use super::parse::{Leaf, NodeKind, Tree};

/// Numbers of states, inputs and parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Sizes {
    pub(super) states: usize,
    pub(super) inputs: usize,
    pub(super) parameters: usize,
}

/// The point of an evaluation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point<'a> {
    pub(super) t: f64,
    pub(super) x: &'a [f64],
    pub(super) u: &'a [f64],
    pub(super) p: &'a [f64],
}

/// Derivatives of states and parameters along some directions: a row for each, an entry for each direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeds<'a> {
    pub(super) states: &'a [f64],
    pub(super) parameters: &'a [f64],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Step {
    operation: Operation,
    a: u32,
    b: u32,
}

/// A compiled list of expressions.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Program {
    sizes: Sizes,
    constants: Vec<f64>,
    steps: Vec<Step>,
    /// The same, but a sine also computes the cosine of its angle if that comes next. One library call for both costs little more than one.
    paired: Vec<Step>,
    /// Number of steps that need only constants and parameters.
    prepared: usize,
    /// The register of each expression.
    roots: Vec<u32>,
    fingerprint: u64,
}

/// The registers of one program.
#[derive(Debug, Clone, Default)]
pub(super) struct Registers {
    values: Vec<f64>,
    tangents: Vec<f64>,
    fingerprint: u64,
}

/// An operand during compilation: registers get their numbers at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Place {
    Constant(u64),
    Leaf(Leaf),
    Step(usize),
}

#[derive(Default)]
struct Builder {
    steps: Vec<(Operation, Place, Place)>,
    known: HashMap<(Operation, Place, Place), Place>,
}

impl Builder {
    fn constant(value: f64) -> Place {
        Place::Constant(value.to_bits())
    }

    fn operation(&mut self, operation: Operation, a: Place, b: Place) -> Place {
        use Operation::{Add, Divide, Multiply, Negate, Power, Sqrt, Subtract};
        let value = |p: Place| {
            if let Place::Constant(bits) = p { Some(f64::from_bits(bits)) } else { None }
        };
        match (operation, value(a), value(b)) {
            (_, Some(a), Some(b)) => return Self::constant(operation.apply(a, b)),
            (Add, Some(0.0), _) | (Multiply, Some(1.0), _) => return b,
            (Add | Subtract, _, Some(0.0)) | (Multiply | Divide | Power, _, Some(1.0)) => return a,
            (Power, _, Some(2.0)) => return self.operation(Multiply, a, a),
            (Power, _, Some(3.0)) => {
                let square = self.operation(Multiply, a, a);
                return self.operation(Multiply, square, a);
            }
            (Power, _, Some(4.0)) => {
                let square = self.operation(Multiply, a, a);
                return self.operation(Multiply, square, square);
            }
            (Power, _, Some(0.5)) => return self.operation(Sqrt, a, a),
            (Power, _, Some(-1.0)) => return self.operation(Divide, Self::constant(1.0), a),
            _ => {}
        }
        if let (Negate, Place::Step(at)) = (operation, a)
            && let (Negate, inner, _) = self.steps[at]
        {
            return inner;
        }
        // A canonical order of the operands identifies a*b and b*a.
        let rank = |p: Place| match p {
            Place::Constant(bits) => (0, bits, 0),
            Place::Leaf(Leaf::Time) => (1, 0, 0),
            Place::Leaf(Leaf::State(i)) => (2, 0, i),
            Place::Leaf(Leaf::Input(i)) => (3, 0, i),
            Place::Leaf(Leaf::Parameter(i)) => (4, 0, i),
            Place::Step(i) => (5, 0, i),
        };
        let (a, b) = if operation.commutes() && rank(b) < rank(a) { (b, a) } else { (a, b) };
        if let Some(&place) = self.known.get(&(operation, a, b)) {
            return place;
        }
        self.steps.push((operation, a, b));
        let place = Place::Step(self.steps.len() - 1);
        self.known.insert((operation, a, b), place);
        place
    }
}

impl Program {
    /// The expressions of `trees`, which may use `definitions`; each definition may use earlier ones.
    pub(super) fn compile(definitions: &[Tree], trees: &[Tree], sizes: Sizes) -> Self {
        let mut builder = Builder::default();
        let mut defined: Vec<Place> = Vec::with_capacity(definitions.len());
        let mut roots: Vec<Place> = Vec::with_capacity(trees.len());
        for (number, tree) in definitions.iter().chain(trees).enumerate() {
            let root = {
                let mut places: Vec<Place> = Vec::with_capacity(tree.nodes.len());
                for node in &tree.nodes {
                    places.push(match node.kind {
                        NodeKind::Number(value) => Builder::constant(value),
                        NodeKind::Leaf(leaf) => Place::Leaf(leaf),
                        NodeKind::Definition(at) => {
                            defined.get(at).copied().unwrap_or(Builder::constant(f64::NAN))
                        }
                        NodeKind::Operation(operation, a, b) => {
                            builder.operation(operation, places[a], places[b])
                        }
                    });
                }
                places.last().copied().unwrap_or(Builder::constant(f64::NAN))
            };
            if number < definitions.len() { defined.push(root) } else { roots.push(root) }
        }
        Self::lay_out(&builder.steps, &roots, sizes)
    }

    fn lay_out(steps: &[(Operation, Place, Place)], roots: &[Place], sizes: Sizes) -> Self {
        let (order, prepared) = Self::order(steps, roots);
        let mut numbers: HashMap<u64, u32> = HashMap::new();
        let mut constants = Vec::new();
        for p in order.iter().flat_map(|&i| [steps[i].1, steps[i].2]).chain(roots.iter().copied()) {
            if let Place::Constant(bits) = p {
                numbers.entry(bits).or_insert_with(|| {
                    constants.push(f64::from_bits(bits));
                    register(constants.len() - 1)
                });
            }
        }
        let time = constants.len();
        let base = time + 1 + sizes.states + sizes.inputs + sizes.parameters;
        let mut place_of = vec![0; steps.len()];
        for (k, &i) in order.iter().enumerate() {
            place_of[i] = base + k;
        }
        let number = |p: Place| match p {
            Place::Constant(bits) => numbers.get(&bits).copied().unwrap_or(0),
            Place::Leaf(Leaf::Time) => register(time),
            Place::Leaf(Leaf::State(i)) => register(time + 1 + i),
            Place::Leaf(Leaf::Input(i)) => register(time + 1 + sizes.states + i),
            Place::Leaf(Leaf::Parameter(i)) => register(time + 1 + sizes.states + sizes.inputs + i),
            Place::Step(i) => register(place_of[i]),
        };
        let steps: Vec<Step> = order
            .iter()
            .map(|&i| Step { operation: steps[i].0, a: number(steps[i].1), b: number(steps[i].2) })
            .collect();
        let mut paired = steps.clone();
        for k in 1..steps.len() {
            if (steps[k - 1].operation, steps[k].operation) == (Operation::Sin, Operation::Cos)
                && steps[k - 1].a == steps[k].a
            {
                paired[k - 1].operation = Operation::SinCos;
                paired[k] = Step { operation: Operation::Found, b: register(base + k), ..steps[k] };
            }
        }
        let mut program = Self {
            sizes,
            constants,
            steps,
            paired,
            prepared,
            roots: roots.iter().map(|&r| number(r)).collect(),
            fingerprint: 0,
        };
        program.fingerprint = program.hash();
        program
    }

    /// The required steps, those of parameters and constants first, and the number of the latter.
    fn order(steps: &[(Operation, Place, Place)], roots: &[Place]) -> (Vec<usize>, usize) {
        // Folding leaves unused steps behind.
        let mut needed = vec![false; steps.len()];
        let mark = |p: Place, needed: &mut Vec<bool>| {
            if let Place::Step(i) = p {
                needed[i] = true;
            }
        };
        roots.iter().for_each(|&r| mark(r, &mut needed));
        for i in (0..steps.len()).rev() {
            if needed[i] {
                mark(steps[i].1, &mut needed);
                mark(steps[i].2, &mut needed);
            }
        }
        let mut early = vec![false; steps.len()];
        for (i, (_, a, b)) in steps.iter().enumerate() {
            early[i] = [a, b].into_iter().all(|p| match p {
                Place::Constant(_) | Place::Leaf(Leaf::Parameter(_)) => true,
                Place::Leaf(_) => false,
                Place::Step(i) => early[*i],
            });
        }
        let mut order: Vec<usize> = (0..steps.len()).filter(|&i| needed[i] && early[i]).collect();
        let prepared = order.len();
        order.extend((0..steps.len()).filter(|&i| needed[i] && !early[i]));
        pair_up(&mut order, steps);
        (order, prepared)
    }

    /// Identifies a program, so that its registers are never used by another.
    fn hash(&self) -> u64 {
        let mut hasher = std::hash::DefaultHasher::new();
        (self.sizes, &self.steps, &self.roots).hash(&mut hasher);
        self.constants.iter().for_each(|c| c.to_bits().hash(&mut hasher));
        hasher.finish().max(1)
    }

    fn base(&self) -> usize {
        self.constants.len() + 1 + self.sizes.states + self.sizes.inputs + self.sizes.parameters
    }

    /// Resizes registers for this program; allocates when they belonged to another.
    pub(super) fn fit(&self, registers: &mut Registers) {
        registers.values.clear();
        registers.values.extend_from_slice(&self.constants);
        registers.values.resize(self.base() + self.steps.len(), f64::NAN);
        let widest = self.sizes.states.max(self.sizes.inputs).max(self.sizes.parameters);
        registers.tangents.resize(registers.values.len() * widest, 0.0);
        registers.fingerprint = self.fingerprint;
    }

    /// Evaluates at a point. Slices shorter than the model's lists leave registers unchanged; callers check the lengths.
    #[inline]
    fn run(&self, at: Point<'_>, registers: &mut Registers) {
        if registers.fingerprint != self.fingerprint {
            self.fit(registers);
        }
        let values = &mut registers.values[..];
        let Sizes { states, inputs, parameters } = self.sizes;
        let time = self.constants.len();
        values[time] = at.t;
        let leaves = &mut values[time + 1..time + 1 + states + inputs + parameters];
        let (x, leaves) = leaves.split_at_mut(states);
        let (u, p) = leaves.split_at_mut(inputs);
        x.iter_mut().zip(at.x).for_each(|(to, from)| *to = *from);
        u.iter_mut().zip(at.u).for_each(|(to, from)| *to = *from);
        let mut first = self.prepared;
        for (to, from) in p.iter_mut().zip(at.p) {
            if to.to_bits() != from.to_bits() {
                *to = *from;
                first = 0;
            }
        }
        let base = time + 1 + states + inputs + parameters;
        for (k, step) in self.paired.iter().enumerate().skip(first) {
            let (a, b) = (values[step.a as usize], values[step.b as usize]);
            match step.operation {
                Operation::SinCos => (values[base + k], values[base + k + 1]) = a.sin_cos(),
                operation => values[base + k] = operation.apply(a, b),
            }
        }
    }

    /// The values of the expressions.
    #[inline]
    pub(super) fn evaluate(&self, at: Point<'_>, registers: &mut Registers, to: &mut [f64]) {
        self.run(at, registers);
        for (to, &root) in to.iter_mut().zip(&self.roots) {
            *to = registers.values[root as usize];
        }
    }

    /// Derivatives of the expressions with respect to `count` leaves from `first`, column by column.
    pub(super) fn differentiate(
        &self,
        at: Point<'_>,
        leaves: (usize, usize),
        registers: &mut Registers,
        jacobian: &mut [f64],
    ) {
        self.run(at, registers);
        let (first, count) = leaves;
        let (base, rows) = (self.base(), self.roots.len());
        let first = self.constants.len() + first;
        let tangents = &mut registers.tangents[..];
        tangents[..base * count].fill(0.0);
        for i in 0..count {
            tangents[(first + i) * count + i] = 1.0;
        }
        self.propagate(count, registers);
        for (i, &root) in self.roots.iter().enumerate() {
            for j in 0..count {
                jacobian[i + rows * j] = registers.tangents[root as usize * count + j];
            }
        }
    }

    /// Values of the expressions and their derivatives along `count` directions, row by row; inputs and time are constant.
    pub(super) fn along(
        &self,
        at: Point<'_>,
        count: usize,
        seeds: Seeds<'_>,
        registers: &mut Registers,
        to: &mut [f64],
        tangents: &mut [f64],
    ) {
        self.evaluate(at, registers, to);
        if count == 0 {
            return;
        }
        let base = self.base();
        let needed = registers.values.len() * count;
        if registers.tangents.len() < needed {
            registers.tangents.resize(needed, 0.0);
        }
        let Sizes { states, inputs, parameters } = self.sizes;
        let first = (self.constants.len() + 1) * count;
        registers.tangents[..base * count].fill(0.0);
        registers.tangents[first..first + states * count]
            .copy_from_slice(&seeds.states[..states * count]);
        let first = first + (states + inputs) * count;
        registers.tangents[first..first + parameters * count]
            .copy_from_slice(&seeds.parameters[..parameters * count]);
        self.propagate(count, registers);
        for (row, &root) in tangents.chunks_exact_mut(count).zip(&self.roots) {
            row.copy_from_slice(&registers.tangents[root as usize * count..][..count]);
        }
    }

    /// Propagates the tangents of the leaves, `count` each, through the steps.
    fn propagate(&self, count: usize, registers: &mut Registers) {
        let base = self.base();
        let Registers { values, tangents, .. } = registers;
        for (k, step) in self.steps.iter().enumerate() {
            let (a, b) = (step.a as usize, step.b as usize);
            let (da, db) = step.operation.partials(values[a], values[b], values[base + k]);
            let (before, row) = tangents.split_at_mut((base + k) * count);
            let (of_a, of_b) =
                (&before[a * count..(a + 1) * count], &before[b * count..(b + 1) * count]);
            for ((to, ta), tb) in row.iter_mut().zip(of_a).zip(of_b) {
                // A value independent of the leaf keeps the derivative 0 where a partial is infinite.
                let part = |d: f64, tangent: f64| if tangent == 0.0 { 0.0 } else { d * tangent };
                *to = part(da, *ta) + part(db, *tb);
            }
        }
    }

    /// Whether every expression is affine in states and inputs, with coefficients from constants and parameters only.
    pub(super) fn is_affine(&self) -> bool {
        const BENT: u8 = 2;
        let Sizes { states, inputs, .. } = self.sizes;
        // The degree of every register in states and inputs; time counts as nonlinear.
        let mut degree = vec![0; self.base() + self.steps.len()];
        let time = self.constants.len();
        degree[time] = BENT;
        degree[time + 1..=time + states + inputs].fill(1);
        for (k, step) in self.steps.iter().enumerate() {
            let (a, b) = (degree[step.a as usize], degree[step.b as usize]);
            degree[self.base() + k] = match step.operation {
                Operation::Add | Operation::Subtract => a.max(b),
                Operation::Multiply => BENT.min(a + b),
                Operation::Divide if b == 0 => a,
                Operation::Negate => a,
                _ if a == 0 && b == 0 => 0,
                _ => BENT,
            };
        }
        self.roots.iter().all(|&root| degree[root as usize] < BENT)
    }

    /// Whether an expression depends on a leaf (counted from time, states, inputs, parameters).
    pub(super) fn depends(&self, expression: usize, leaf: usize) -> bool {
        let base = self.base();
        let wanted = register(self.constants.len() + leaf);
        let Some(&root) = self.roots.get(expression) else { return false };
        let mut reached = vec![false; base + self.steps.len()];
        reached[root as usize] = true;
        for (k, step) in self.steps.iter().enumerate().rev() {
            if reached[base + k] {
                reached[step.a as usize] = true;
                reached[step.b as usize] = true;
            }
        }
        reached[wanted as usize]
    }

    /// Steps of one evaluation, without those that change only with a parameter.
    pub(super) fn len(&self) -> usize {
        self.steps.len() - self.prepared
    }
}

/// The number of registers is bounded by the length of expressions: far below 2³².
fn register(at: usize) -> u32 {
    at as u32
}

/// Moves the cosine of an angle directly behind its sine: both need only the angle.
fn pair_up(order: &mut [usize], steps: &[(Operation, Place, Place)]) {
    for k in 0..order.len() {
        let partner = match steps[order[k]].0 {
            Operation::Sin => Operation::Cos,
            Operation::Cos => Operation::Sin,
            _ => continue,
        };
        let angle = steps[order[k]].1;
        if let Some(at) = (k + 1..order.len())
            .find(|&at| steps[order[at]].0 == partner && steps[order[at]].1 == angle)
        {
            order[k + 1..=at].rotate_right(1);
            if partner == Operation::Sin {
                order.swap(k, k + 1);
            }
        }
    }
}
