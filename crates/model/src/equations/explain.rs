//! The reason why an expression has no finite value at a point.

use std::fmt;

use super::function::Operation;
use super::parse::{Leaf, NodeKind, Tree};
use super::program::Point;

/// The first part of an equation without a finite value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{equation}: {part} {breakdown} at t = {time_s} s")]
pub struct NonFinite {
    /// The equation, as `derivatives.speed`.
    pub equation: String,
    /// The part's text.
    pub part: String,
    /// The cause.
    pub breakdown: Breakdown,
    /// The time, s.
    pub time_s: f64,
}

/// The cause of a value that is not finite.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Breakdown {
    /// A division by zero.
    DivisionByZero,
    /// A function outside of its domain.
    Domain {
        /// `log`, `sqrt`, …
        function: &'static str,
        /// Its argument.
        argument: f64,
    },
    /// A power of a negative number, or of 0 with a negative exponent.
    Power {
        /// The base.
        base: f64,
        /// The exponent.
        exponent: f64,
    },
    /// A value above the largest float.
    Overflow,
    /// A state, input or parameter that is NaN or infinite on input.
    Given {
        /// The input value.
        value: f64,
    },
}

impl fmt::Display for Breakdown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DivisionByZero => write!(f, "divides by zero"),
            Self::Domain { function, argument } => {
                write!(f, "takes the {function} of {argument}, which has none")
            }
            Self::Power { base, exponent } => {
                write!(f, "raises {base} to the power {exponent}, which has no value")
            }
            Self::Overflow => write!(f, "grows beyond all numbers"),
            Self::Given { value } => write!(f, "is {value}"),
        }
    }
}

/// The first part of the tree without a finite value whose own parts are finite; `None` if the whole is finite.
pub(super) fn explain(
    equation: &str,
    tree: &Tree,
    defined: &[f64],
    at: Point<'_>,
) -> Option<NonFinite> {
    let values = values(tree, defined, at);
    if values.last()?.is_finite() {
        return None;
    }
    let broken = values.iter().position(|v| !v.is_finite())?;
    let breakdown = match tree.nodes[broken].kind {
        NodeKind::Operation(operation, a, b) => breakdown(operation, values[a], values[b]),
        NodeKind::Number(value) => Breakdown::Given { value },
        NodeKind::Leaf(_) | NodeKind::Definition(_) => Breakdown::Given { value: values[broken] },
    };
    Some(NonFinite {
        equation: equation.to_owned(),
        part: tree.said(broken).to_owned(),
        breakdown,
        time_s: at.t,
    })
}

/// The values of all nodes, given those of the definitions.
pub(super) fn values(tree: &Tree, defined: &[f64], at: Point<'_>) -> Vec<f64> {
    let mut values: Vec<f64> = Vec::with_capacity(tree.nodes.len());
    for node in &tree.nodes {
        let of = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(f64::NAN);
        values.push(match node.kind {
            NodeKind::Number(value) => value,
            NodeKind::Definition(i) => of(defined, i),
            NodeKind::Leaf(Leaf::Time) => at.t,
            NodeKind::Leaf(Leaf::State(i)) => of(at.x, i),
            NodeKind::Leaf(Leaf::Input(i)) => of(at.u, i),
            NodeKind::Leaf(Leaf::Parameter(i)) => of(at.p, i),
            NodeKind::Operation(operation, a, b) => operation.apply(values[a], values[b]),
        });
    }
    values
}

fn breakdown(operation: Operation, a: f64, b: f64) -> Breakdown {
    let domain = |function| Breakdown::Domain { function, argument: a };
    match operation {
        Operation::Divide if b == 0.0 => Breakdown::DivisionByZero,
        Operation::Log => domain("logarithm"),
        Operation::Sqrt => domain("square root"),
        Operation::Asin => domain("arc sine"),
        Operation::Acos => domain("arc cosine"),
        Operation::Power if a < 0.0 && b.fract() != 0.0 => {
            Breakdown::Power { base: a, exponent: b }
        }
        Operation::Power if a == 0.0 => Breakdown::Power { base: a, exponent: b },
        _ => Breakdown::Overflow,
    }
}
