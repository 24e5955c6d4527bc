//! Quantities inside a model, and the model with a map applied to one of them.
//!
//! A quantity is a named expression, or a term of a derivative, named by its own text. A quantity that compares a command with a state (a sum of both enters
//! it) is a controller's. A quantity that compares two states, without other signals, is a link between bodies.
//!
//! How it can be wrong: an expanded term (`kp*target - kp*q`) is not found; a named expression is. A limit on a part of an actuator's output (a controller's
//! proportional part) differs from a limit of the whole: the whole needs a name.

use super::error::EquationError;
use super::function::Operation;
use super::parse::{Leaf, NodeKind, Tree, parse};
use super::system::{Definition, Equations, OutputVariable, Parameter, Symbol};

/// The signals that enter an expression.
#[derive(Debug, Clone, Copy, Default)]
struct Moved {
    /// An input enters.
    input: bool,
    /// A state enters.
    state: bool,
    /// A sum of an input-dependent and a state-dependent part enters it.
    compares: bool,
}

impl Moved {
    fn or(self, other: Self) -> Self {
        Self {
            input: self.input || other.input,
            state: self.state || other.state,
            compares: self.compares || other.compares,
        }
    }
}

/// The map applied to a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InnerMap {
    /// min(max(v, lower), upper): two parameters.
    Limits,
    /// v − min(max(v, −width), width): one parameter.
    DeadZone,
    /// v + level·tanh(v′/speed): two parameters. v is a difference of two positions.
    Friction,
}

/// Prefix of added parameters, unused in models.
const ADDED: &str = "inner_";
const QUANTITY: &str = "inner_quantity";

impl Equations {
    /// The quantities that compare a command with a state: named expressions, then terms of derivatives by their own text.
    #[must_use]
    pub fn controls(&self) -> Vec<String> {
        let moved = self.definitions_moved();
        let named = self.definitions.iter().zip(&moved);
        let mut found: Vec<String> =
            named.filter(|(_, m)| m.compares).map(|(d, _)| d.name.clone()).collect();
        for tree in &self.derivative_trees {
            let of = self.nodes_moved(tree, &moved);
            let mut terms = Vec::new();
            terms_of(tree, &of, tree.nodes.len() - 1, false, &mut terms);
            for node in terms {
                // A name alone is listed with the definitions.
                let named = matches!(tree.nodes[node].kind, NodeKind::Definition(_));
                let text = stripped(tree.said(node)).to_owned();
                if !named && !found.contains(&text) {
                    found.push(text);
                }
            }
        }
        found
    }

    /// The differences of two states in derivatives, by their own text: the twist of a link between bodies.
    #[must_use]
    pub fn links(&self) -> Vec<String> {
        let mut found: Vec<String> = Vec::new();
        for tree in self.derivative_trees.iter().chain(&self.definition_trees) {
            for (at, node) in tree.nodes.iter().enumerate() {
                let NodeKind::Operation(Operation::Subtract, a, b) = node.kind else { continue };
                let leaf = |i: usize| match tree.nodes[i].kind {
                    NodeKind::Leaf(Leaf::State(s)) => Some(s),
                    _ => None,
                };
                let (Some(a), Some(b)) = (leaf(a), leaf(b)) else { continue };
                let text = stripped(tree.said(at)).to_owned();
                if a != b
                    && self.is_coordinate(a)
                    && self.is_coordinate(b)
                    && !found.contains(&text)
                {
                    found.push(text);
                }
            }
        }
        found
    }

    /// The derivative of a state is another state alone: the state is a position.
    fn is_coordinate(&self, state: usize) -> bool {
        self.speed(state).is_some()
    }

    /// The state that is the derivative of a position.
    fn speed(&self, position: usize) -> Option<usize> {
        match self.derivative_trees[position].nodes.last()?.kind {
            NodeKind::Leaf(Leaf::State(speed)) => Some(speed),
            _ => None,
        }
    }

    /// The names of the speeds of the two positions in a twist.
    fn twist_rates(&self, twist: &str) -> Option<[&str; 2]> {
        let tree = parse("quantity", twist, &self.names()).ok()?;
        let NodeKind::Operation(Operation::Subtract, a, b) = tree.nodes.last()?.kind else {
            return None;
        };
        let rate = |node: usize| match tree.nodes[node].kind {
            NodeKind::Leaf(Leaf::State(position)) => {
                Some(self.states[self.speed(position)?].name.as_str())
            }
            _ => None,
        };
        Some([rate(a)?, rate(b)?])
    }

    /// The model with a map applied to a quantity; the map's parameters follow all others. `None` for a text that is no quantity of this model.
    ///
    /// # Errors
    /// [`EquationError`] where the model exceeds the size limits.
    pub fn with_inner_map(
        &self,
        quantity: &str,
        map: InnerMap,
    ) -> Result<Option<Self>, EquationError> {
        let free = |suffix: &str| self.free_name(suffix);
        let raw = free("raw");
        let (names, text) = match map {
            InnerMap::Limits => {
                let (lower, upper) = (free("lower"), free("upper"));
                let text = format!("min(max({raw}, {lower}), {upper})");
                (vec![lower, upper], text)
            }
            InnerMap::DeadZone => {
                let width = free("width");
                let text = format!("{raw} - min(max({raw}, -{width}), {width})");
                (vec![width], text)
            }
            InnerMap::Friction => {
                let Some([a, b]) = self.twist_rates(quantity) else { return Ok(None) };
                let (level, speed) = (free("level"), free("speed"));
                let text = format!("{raw} + {level}*tanh(({a} - {b})/{speed})");
                (vec![level, speed], text)
            }
        };
        let mut parameters = self.parameters.clone();
        parameters.extend(names.into_iter().map(|name| Parameter { name, unit: None, value: 0.0 }));
        let Some(at) = self.opened(quantity) else { return Ok(None) };
        let Opened { mut definitions, place, name, derivatives, outputs, expression } = at;
        let added = [
            Definition { name: raw, expression },
            Definition { name: name.clone(), expression: text },
        ];
        definitions.splice(place..place, added);
        let states = (self.states.iter().zip(derivatives))
            .map(|(s, derivative)| super::system::StateVariable { derivative, ..s.clone() })
            .collect();
        let outputs = (self.outputs.iter().zip(outputs))
            .map(|(o, equation)| OutputVariable { equation, ..o.clone() })
            .collect();
        Self::with_definitions(self.inputs.clone(), states, parameters, definitions, outputs)
            .map(Some)
    }

    /// The model with a quantity as its last input, and the quantity's own value as the last output. `None` for a text that is no quantity of this model.
    ///
    /// # Errors
    /// [`EquationError`] where the model exceeds the size limits.
    pub fn with_open_quantity(&self, quantity: &str) -> Result<Option<Self>, EquationError> {
        let Some(at) = self.opened(quantity) else { return Ok(None) };
        let Opened { definitions, name, derivatives, outputs, expression, .. } = at;
        let states = (self.states.iter().zip(derivatives))
            .map(|(s, derivative)| super::system::StateVariable { derivative, ..s.clone() })
            .collect();
        let mut outputs: Vec<OutputVariable> = (self.outputs.iter().zip(outputs))
            .map(|(o, equation)| OutputVariable { equation, ..o.clone() })
            .collect();
        outputs.push(OutputVariable {
            name: self.free_name("raw"),
            unit: None,
            equation: expression,
        });
        let mut inputs = self.inputs.clone();
        inputs.push(Symbol { name, unit: None });
        Self::with_definitions(inputs, states, self.parameters.clone(), definitions, outputs)
            .map(Some)
    }

    /// The model with the value of a quantity as its last output. `None` for a text that is no quantity of this model.
    ///
    /// # Errors
    /// [`EquationError`] where the model exceeds the size limits.
    pub fn with_shown_quantity(&self, quantity: &str) -> Result<Option<Self>, EquationError> {
        let Some(at) = self.opened(quantity) else { return Ok(None) };
        let mut outputs = self.outputs.clone();
        let equation = match self.definitions.iter().any(|d| d.name == quantity) {
            true => quantity.to_owned(),
            false => at.expression,
        };
        outputs.push(OutputVariable { name: self.free_name("raw"), unit: None, equation });
        let definitions = self.definitions.clone();
        let (inputs, states) = (self.inputs.clone(), self.states.clone());
        Self::with_definitions(inputs, states, self.parameters.clone(), definitions, outputs)
            .map(Some)
    }

    /// A name that is unused in this model.
    fn free_name(&self, suffix: &str) -> String {
        let taken = |name: &str| {
            self.inputs.iter().any(|s| s.name == name)
                || self.states.iter().any(|s| s.name == name)
                || self.parameters.iter().any(|s| s.name == name)
                || self.definitions.iter().any(|s| s.name == name)
                || self.outputs.iter().any(|s| s.name == name)
        };
        let mut number = 1;
        loop {
            let name = format!("{ADDED}{suffix}_{number}");
            if !taken(&name) {
                return name;
            }
            number += 1;
        }
    }

    /// The index of the definition of a quantity: its own, or that from a map of the term.
    fn defined(&self, quantity: &str) -> Option<usize> {
        let own = self.definitions.iter().position(|d| d.name == quantity);
        own.or_else(|| {
            let raw = self
                .definitions
                .iter()
                .position(|d| d.name.starts_with(ADDED) && d.expression == quantity)?;
            let behind = self.definitions[raw..].iter();
            Some(raw + behind.enumerate().find(|(_, d)| d.name.starts_with(QUANTITY))?.0)
        })
    }

    /// The equations with the quantity under an undefined name.
    fn opened(&self, quantity: &str) -> Option<Opened> {
        if let Some(place) = self.defined(quantity) {
            let mut definitions = self.definitions.clone();
            let defined = definitions.remove(place);
            return Some(Opened {
                definitions,
                place,
                name: defined.name,
                derivatives: self.states.iter().map(|s| s.derivative.clone()).collect(),
                outputs: self.outputs.iter().map(|o| o.equation.clone()).collect(),
                expression: defined.expression,
            });
        }
        let tree = parse("quantity", quantity, &self.names()).ok()?;
        let name = self.free_name("quantity");
        let mut found = false;
        let mut replaced = |trees: &[Tree]| -> Vec<String> {
            trees
                .iter()
                .map(|t| {
                    let (text, times) = replace(t, &tree, &name);
                    found |= times > 0;
                    text
                })
                .collect()
        };
        let derivatives = replaced(&self.derivative_trees);
        let outputs = replaced(&self.output_trees);
        let in_definitions = replaced(&self.definition_trees);
        // A definition that contains the term comes after it.
        let place = in_definitions
            .iter()
            .zip(&self.definitions)
            .position(|(now, before)| *now != before.expression)
            .unwrap_or(self.definitions.len());
        let definitions = (self.definitions.iter().zip(in_definitions))
            .map(|(d, expression)| Definition { expression, ..d.clone() })
            .collect();
        found.then(|| Opened {
            definitions,
            place,
            name,
            derivatives,
            outputs,
            expression: quantity.to_owned(),
        })
    }

    /// The signals that enter each definition.
    fn definitions_moved(&self) -> Vec<Moved> {
        let mut moved = Vec::new();
        for tree in &self.definition_trees {
            let of = self.nodes_moved(tree, &moved);
            moved.push(of.last().copied().unwrap_or_default());
        }
        moved
    }

    /// The signals that enter each node of a tree.
    fn nodes_moved(&self, tree: &Tree, definitions: &[Moved]) -> Vec<Moved> {
        let mut of: Vec<Moved> = Vec::with_capacity(tree.nodes.len());
        for node in &tree.nodes {
            of.push(match node.kind {
                NodeKind::Number(_) | NodeKind::Leaf(Leaf::Time | Leaf::Parameter(_)) => {
                    Moved::default()
                }
                NodeKind::Leaf(Leaf::State(_)) => Moved { state: true, ..Moved::default() },
                NodeKind::Leaf(Leaf::Input(_)) => Moved { input: true, ..Moved::default() },
                NodeKind::Definition(at) => definitions.get(at).copied().unwrap_or_default(),
                NodeKind::Operation(operation, a, b) => {
                    let both = of[a].or(of[b]);
                    let sum = matches!(operation, Operation::Add | Operation::Subtract);
                    let compares = sum && both.input && both.state;
                    Moved { compares: both.compares || compares, ..both }
                }
            });
        }
        of
    }
}

/// Equations with an open quantity.
struct Opened {
    definitions: Vec<Definition>,
    /// The index for its definition.
    place: usize,
    /// Its name in the equations.
    name: String,
    derivatives: Vec<String>,
    outputs: Vec<String>,
    /// Its expression.
    expression: String,
}

/// The terms of the innermost sums that compare a command with a state. `is_term`: the node is a term of a sum itself.
fn terms_of(tree: &Tree, moved: &[Moved], node: usize, is_term: bool, found: &mut Vec<usize>) {
    if !moved[node].compares {
        return;
    }
    let mut inner = node;
    // Factors without a comparison scale it.
    while let NodeKind::Operation(operation, a, b) = tree.nodes[inner].kind {
        inner = match operation {
            Operation::Negate => a,
            Operation::Divide | Operation::Multiply if moved[a].compares && !moved[b].compares => a,
            Operation::Multiply if moved[b].compares && !moved[a].compares => b,
            _ => break,
        };
    }
    let before = found.len();
    let mut open = vec![inner];
    while let Some(at) = open.pop() {
        match tree.nodes[at].kind {
            // The operands of a nested sum are terms of both sums.
            NodeKind::Operation(Operation::Add | Operation::Subtract, a, b) => open.extend([b, a]),
            _ if at != inner => terms_of(tree, moved, at, true, found),
            _ => {}
        }
    }
    if found.len() == before && is_term {
        found.push(node);
    }
}

/// Two expressions are equal.
fn same(a: (&Tree, usize), b: (&Tree, usize)) -> bool {
    let node = |(tree, at): (&Tree, usize)| tree.nodes[at].kind;
    match (node(a), node(b)) {
        (NodeKind::Operation(of_a, l, r), NodeKind::Operation(of_b, m, s)) => {
            of_a == of_b && same((a.0, l), (b.0, m)) && same((a.0, r), (b.0, s))
        }
        (NodeKind::Number(x), NodeKind::Number(y)) => x.to_bits() == y.to_bits(),
        (x, y) => x == y,
    }
}

/// The text of an expression with a name in place of every occurrence of another one, and the number of occurrences.
fn replace(tree: &Tree, what: &Tree, name: &str) -> (String, usize) {
    let whole = what.nodes.len() - 1;
    let mut spans: Vec<(usize, usize)> = (0..tree.nodes.len())
        .filter(|&at| same((tree, at), (what, whole)))
        .map(|at| (tree.nodes[at].span.from, tree.nodes[at].span.to))
        .collect();
    spans.sort_unstable();
    spans.dedup();
    let mut text = tree.text.clone();
    for (from, to) in spans.iter().rev() {
        text.replace_range(*from..*to, &format!("({name})"));
    }
    (text, spans.len())
}

/// Without parentheses around the whole.
fn stripped(text: &str) -> &str {
    let inner = text.strip_prefix('(').and_then(|t| t.strip_suffix(')'));
    let Some(inner) = inner else { return text };
    let mut depth = 0i32;
    for c in inner.chars() {
        depth += match c {
            '(' => 1,
            ')' => -1,
            _ => 0,
        };
        if depth < 0 {
            return text;
        }
    }
    stripped(inner.trim())
}
