//! An expression as tokens, and the check of their order.

use super::error::Fault;
use super::function;

/// Bytes of the text, from and to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Span {
    pub(super) from: usize,
    pub(super) to: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Word {
    Number(f64),
    /// A name; its text is that of the span.
    Name,
    Plus,
    Minus,
    Times,
    Over,
    Caret,
    Open,
    Close,
    Comma,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Token {
    pub(super) word: Word,
    pub(super) span: Span,
}

/// The fault and its position.
pub(super) type Wrong = (Span, Fault);

/// Largest number of nested parentheses, signs and powers. The parser is recursive for each.
pub(super) const DEEPEST: usize = 100;
/// Largest number of tokens of one expression.
pub(super) const LONGEST: usize = 20_000;

/// A valid name in expressions.
pub(super) fn is_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_alphabetic() || c == '_') && text.chars().all(in_name)
}

fn in_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The names in an expression, each once, in order, without functions; `None` for an invalid expression.
pub(crate) fn names(text: &str) -> Option<Vec<String>> {
    let mut found: Vec<String> = Vec::new();
    for token in words(text).ok()? {
        let name = text.get(token.span.from..token.span.to).unwrap_or_default();
        if token.word == Word::Name && !is_function(name) && !found.iter().any(|f| f == name) {
            found.push(name.to_owned());
        }
    }
    Some(found)
}

/// The tokens of an expression with verified syntax: every operator between values, every parenthesis closed, limited nesting.
pub(super) fn words(text: &str) -> Result<Vec<Token>, Wrong> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(c) = text[at..].chars().next() {
        let from = at;
        at += c.len_utf8();
        if c.is_whitespace() {
            continue;
        }
        let next_is_digit = text[at..].starts_with(|d: char| d.is_ascii_digit());
        let word = match c {
            '+' => Word::Plus,
            '-' | '−' => Word::Minus,
            '*' => Word::Times,
            '/' => Word::Over,
            '^' => Word::Caret,
            '(' => Word::Open,
            ')' => Word::Close,
            ',' => Word::Comma,
            _ if c.is_ascii_digit() || (c == '.' && next_is_digit) => {
                at = from + number_length(&text[from..]);
                let digits = &text[from..at];
                match digits.parse::<f64>() {
                    Ok(value) if value.is_finite() => Word::Number(value),
                    _ => {
                        return Err((
                            Span { from, to: at },
                            Fault::Number { found: digits.to_owned() },
                        ));
                    }
                }
            }
            _ if c.is_alphabetic() || c == '_' => {
                at += text[at..].find(|c| !in_name(c)).unwrap_or(text.len() - at);
                Word::Name
            }
            found => return Err((Span { from, to: at }, Fault::Character { found })),
        };
        tokens.push(Token { word, span: Span { from, to: at } });
        if tokens.len() > LONGEST {
            return Err((Span { from, to: at }, Fault::TooLong { limit: LONGEST }));
        }
    }
    check(text, &tokens)?;
    Ok(tokens)
}

/// Digits, a point, digits, an exponent, as far as they could form a number: `1e` is an invalid number, not 1 times e.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut at = 0;
    while at < bytes.len() {
        let exponent =
            at > 0 && matches!(bytes[at - 1], b'e' | b'E') && matches!(bytes[at], b'+' | b'-');
        if !(bytes[at].is_ascii_digit() || matches!(bytes[at], b'.' | b'e' | b'E') || exponent) {
            break;
        }
        at += 1;
    }
    at
}

/// Open elements of the syntax.
#[derive(PartialEq)]
enum Pending {
    /// A parenthesis, at this token.
    Group(usize),
    /// The arguments of a function.
    Call(usize),
    /// A sign or a power, ended by the next weaker operator; counted, because the parser is recursive for it.
    Operator,
}

fn check(text: &str, tokens: &[Token]) -> Result<(), Wrong> {
    if tokens.is_empty() {
        let first = text.chars().next().map_or(0, char::len_utf8);
        return Err((Span { from: 0, to: first }, Fault::Empty));
    }
    let mut pending: Vec<Pending> = Vec::new();
    let mut value_expected = true;
    for (k, token) in tokens.iter().enumerate() {
        let previous = k.checked_sub(1).map(|i| &tokens[i]);
        let after_name = previous.is_some_and(|p| p.word == Word::Name);
        match (token.word, value_expected) {
            (Word::Number(_) | Word::Name, true) => value_expected = false,
            (Word::Open, true) => pending.push(Pending::Group(k)),
            (Word::Open, false) if after_name => {
                pending.push(Pending::Call(k));
                value_expected = true;
            }
            (Word::Plus | Word::Minus, true) => pending.push(Pending::Operator),
            (Word::Caret, false) => {
                pending.push(Pending::Operator);
                value_expected = true;
            }
            (Word::Plus | Word::Minus | Word::Times | Word::Over, false) => {
                drop_operators(&mut pending);
                value_expected = true;
            }
            // f() is a call with no argument; the check of the number of arguments reports it.
            (Word::Close, true) if after_open_call(tokens, k, &pending) => {
                pending.pop();
                value_expected = false;
            }
            (Word::Close, false) => {
                drop_operators(&mut pending);
                if pending.pop().is_none() {
                    return Err((token.span, Fault::Unopened));
                }
            }
            (Word::Comma, false) => {
                drop_operators(&mut pending);
                if !matches!(pending.last(), Some(Pending::Call(_))) {
                    return Err((token.span, Fault::Comma));
                }
                value_expected = true;
            }
            _ => return Err(misplaced(text, token, previous, value_expected, &pending)),
        }
        if pending.len() > DEEPEST {
            return Err((token.span, Fault::TooDeep { limit: DEEPEST }));
        }
    }
    if value_expected {
        let end = tokens.last().map_or(0, |t| t.span.to);
        return Err((Span { from: end, to: end }, Fault::ValueExpected { found: None }));
    }
    drop_operators(&mut pending);
    match pending.last() {
        Some(Pending::Group(k) | Pending::Call(k)) => Err((tokens[*k].span, Fault::Unclosed)),
        _ => Ok(()),
    }
}

/// The fault of a token at its position.
fn misplaced(
    text: &str,
    token: &Token,
    previous: Option<&Token>,
    value_expected: bool,
    pending: &[Pending],
) -> Wrong {
    let found = text[token.span.from..token.span.to].to_owned();
    let doubled = previous.is_some_and(|p| p.word == Word::Times && p.span.to == token.span.from);
    match token.word {
        _ if !value_expected => (token.span, Fault::OperatorExpected { found }),
        Word::Close if pending.iter().all(|p| *p == Pending::Operator) => {
            (token.span, Fault::Unopened)
        }
        Word::Times if doubled => {
            let span = Span { from: token.span.from - 1, to: token.span.to };
            (span, Fault::ValueExpected { found: Some("**".to_owned()) })
        }
        _ => (token.span, Fault::ValueExpected { found: Some(found) }),
    }
}

fn drop_operators(pending: &mut Vec<Pending>) {
    while pending.last() == Some(&Pending::Operator) {
        pending.pop();
    }
}

fn after_open_call(tokens: &[Token], k: usize, pending: &[Pending]) -> bool {
    k > 0
        && matches!(pending.last(), Some(Pending::Call(open)) if *open == k - 1)
        && tokens[k - 1].word == Word::Open
}

/// The token is a function's name.
pub(super) fn is_function(name: &str) -> bool {
    function::find(name).is_some()
}
