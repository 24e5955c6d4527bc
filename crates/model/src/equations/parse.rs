//! From the text of an expression to a tree: precedence by winnow's Pratt parser, names by a scope.
//!
//! From weak to strong: `+ −`, `* /`, signs, `^` (right associative). So −2^2 = −4, 2^3^2 = 512 and 2^−1 = 0.5.

use winnow::combinator::{Infix, Postfix, Prefix, expression, fail};
use winnow::error::EmptyError;
use winnow::prelude::*;
use winnow::stream::{Stateful, TokenSlice};
use winnow::token::any;

use super::error::{EquationError, Fault, closest};
use super::function::{self, Operation};
use super::token::{Span, Token, Word, Wrong, is_function, words};

/// The meaning of a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Leaf {
    Time,
    State(usize),
    Input(usize),
    Parameter(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum NodeKind {
    Number(f64),
    Leaf(Leaf),
    /// A previously defined named expression, by its index.
    Definition(usize),
    /// One operand (given twice) or two, which come before the node.
    Operation(Operation, usize, usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Node {
    pub(super) kind: NodeKind,
    pub(super) span: Span,
}

/// An expression: nodes after their operands, the whole last.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tree {
    pub(super) text: String,
    pub(super) nodes: Vec<Node>,
}

/// The meaning of names.
pub(super) trait Scope {
    fn find(&self, name: &str) -> Option<Leaf>;
    fn definition(&self, name: &str) -> Option<usize>;
    fn names(&self) -> Vec<String>;
}

/// The state of the parser.
struct Growing<'t> {
    text: &'t str,
    scope: &'t dyn Scope,
    nodes: Vec<Node>,
    /// The first fault in the names.
    wrong: Option<Wrong>,
}

impl std::fmt::Debug for Growing<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Growing").field("nodes", &self.nodes.len()).finish()
    }
}

type Input<'t> = Stateful<TokenSlice<'t, Token>, Growing<'t>>;
type Parsed<O> = Result<O, EmptyError>;

impl Growing<'_> {
    fn push(&mut self, kind: NodeKind, span: Span) -> usize {
        self.nodes.push(Node { kind, span });
        self.nodes.len() - 1
    }

    fn span(&self, node: usize) -> Span {
        self.nodes[node].span
    }

    /// Only the first fault is reported; parsing continues with a zero.
    fn fault(&mut self, span: Span, fault: Fault) -> usize {
        self.wrong.get_or_insert((span, fault));
        self.push(NodeKind::Number(0.0), span)
    }

    fn name(&mut self, span: Span) -> usize {
        let name = &self.text[span.from..span.to];
        if let Some(leaf) = self.scope.find(name) {
            return self.push(NodeKind::Leaf(leaf), span);
        }
        if let Some(at) = self.scope.definition(name) {
            return self.push(NodeKind::Definition(at), span);
        }
        let fault = match function::find(name) {
            Some((name, ..)) => Fault::FunctionAsName { name },
            None => {
                let known = self.scope.names();
                Fault::UnknownName {
                    name: name.to_owned(),
                    closest: closest(name, known.iter().map(String::as_str)),
                    known,
                }
            }
        };
        self.fault(span, fault)
    }

    fn call(&mut self, name: Span, arguments: &[usize], end: usize) -> usize {
        let span = Span { from: name.from, to: end };
        let called = &self.text[name.from..name.to];
        match (function::find(called), arguments) {
            (Some((_, operation, 1)), &[a]) => {
                self.push(NodeKind::Operation(operation, a, a), span)
            }
            (Some((_, operation, 2)), &[a, b]) => {
                self.push(NodeKind::Operation(operation, a, b), span)
            }
            (Some((function, _, needed)), given) => {
                self.fault(span, Fault::Arguments { function, needed, got: given.len() })
            }
            (None, _)
                if self.scope.find(called).is_some() || self.scope.definition(called).is_some() =>
            {
                // A name before a parenthesis: most often a product without its sign.
                let open = Span { from: name.to, to: name.to + 1 };
                self.fault(open, Fault::OperatorExpected { found: "(".to_owned() })
            }
            (None, _) => {
                let near = closest(called, function::names());
                self.fault(name, Fault::UnknownFunction { name: called.to_owned(), closest: near })
            }
        }
    }
}

fn infix(operation: Operation) -> fn(&mut Input<'_>, usize, usize) -> Parsed<usize> {
    fn join(i: &mut Input<'_>, operation: Operation, a: usize, b: usize) -> Parsed<usize> {
        let span = Span { from: i.state.span(a).from, to: i.state.span(b).to };
        Ok(i.state.push(NodeKind::Operation(operation, a, b), span))
    }
    match operation {
        Operation::Add => |i, a, b| join(i, Operation::Add, a, b),
        Operation::Subtract => |i, a, b| join(i, Operation::Subtract, a, b),
        Operation::Multiply => |i, a, b| join(i, Operation::Multiply, a, b),
        Operation::Divide => |i, a, b| join(i, Operation::Divide, a, b),
        _ => |i, a, b| join(i, Operation::Power, a, b),
    }
}

fn infix_operator<'t>(i: &mut Input<'t>) -> Parsed<Infix<Input<'t>, usize, EmptyError>> {
    Ok(match any.parse_next(i)?.word {
        Word::Plus => Infix::Left(1, infix(Operation::Add)),
        Word::Minus => Infix::Left(1, infix(Operation::Subtract)),
        Word::Times => Infix::Left(3, infix(Operation::Multiply)),
        Word::Over => Infix::Left(3, infix(Operation::Divide)),
        Word::Caret => Infix::Right(7, infix(Operation::Power)),
        _ => return fail.parse_next(i),
    })
}

fn prefix_operator<'t>(i: &mut Input<'t>) -> Parsed<Prefix<Input<'t>, usize, EmptyError>> {
    Ok(match any.parse_next(i)?.word {
        Word::Plus => Prefix(5, |_, a| Ok(a)),
        Word::Minus => Prefix(5, |i, a| {
            // The sign comes before its operand; blanks between them belong to neither.
            let operand = i.state.span(a);
            let from = i.state.text[..operand.from].rfind(['-', '−']).unwrap_or(operand.from);
            Ok(i.state
                .push(NodeKind::Operation(Operation::Negate, a, a), Span { from, to: operand.to }))
        }),
        _ => return fail.parse_next(i),
    })
}

fn value(i: &mut Input<'_>) -> Parsed<usize> {
    let token: Token = *any.parse_next(i)?;
    match token.word {
        Word::Number(value) => Ok(i.state.push(NodeKind::Number(value), token.span)),
        Word::Open => {
            let inner = whole(i)?;
            let close: Token = *any.parse_next(i)?;
            // The parentheses belong to the value, so that its text can be displayed.
            i.state.nodes[inner].span = Span { from: token.span.from, to: close.span.to };
            Ok(inner)
        }
        Word::Name if i.input.first().is_some_and(|next| next.word == Word::Open) => {
            let (mut arguments, mut last) = (Vec::new(), any.parse_next(i)?);
            if i.input.first().is_some_and(|next| next.word == Word::Close) {
                last = any.parse_next(i)?;
            }
            while last.word != Word::Close {
                arguments.push(whole(i)?);
                last = any.parse_next(i)?;
            }
            Ok(i.state.call(token.span, &arguments, last.span.to))
        }
        Word::Name => Ok(i.state.name(token.span)),
        _ => fail.parse_next(i),
    }
}

fn whole(i: &mut Input<'_>) -> Parsed<usize> {
    expression(value)
        .prefix(prefix_operator)
        .infix(infix_operator)
        .postfix(fail::<_, Postfix<_, _, _>, _>)
        .parse_next(i)
}

/// Parses one expression; `equation` is its name in messages.
pub(super) fn parse(equation: &str, text: &str, scope: &dyn Scope) -> Result<Tree, EquationError> {
    let wrong = |(span, fault): Wrong| EquationError::Expression {
        equation: equation.to_owned(),
        text: text.to_owned(),
        column: text[..span.from].chars().count() + 1,
        length: text[span.from..span.to].chars().count().max(1),
        fault: Box::new(fault),
    };
    let tokens = words(text).map_err(wrong)?;
    let state = Growing { text, scope, nodes: Vec::with_capacity(tokens.len()), wrong: None };
    let mut input = Stateful { input: TokenSlice::new(&tokens), state };
    let parsed = whole(&mut input);
    let Growing { mut nodes, wrong: fault, .. } = input.state;
    // `words` has verified the syntax; a disagreement is an error, not a partial expression.
    let parsed = parsed.ok().filter(|_| input.input.is_empty());
    match (fault, parsed) {
        (Some(fault), _) => Err(wrong(fault)),
        (None, None) => {
            let span =
                input.input.first().map_or(Span { from: text.len(), to: text.len() }, |t| t.span);
            Err(wrong((span, Fault::ValueExpected { found: None })))
        }
        (None, Some(root)) => {
            nodes.truncate(root + 1);
            Ok(Tree { text: text.to_owned(), nodes })
        }
    }
}

impl Tree {
    /// The text of a node.
    pub(super) fn said(&self, node: usize) -> &str {
        let span = self.nodes[node].span;
        self.text.get(span.from..span.to).unwrap_or(&self.text)
    }
}

/// The name is reserved by the language.
pub(crate) fn reserved(name: &str) -> Option<&'static str> {
    if name == "time" { Some("the time") } else { is_function(name).then_some("a function") }
}
