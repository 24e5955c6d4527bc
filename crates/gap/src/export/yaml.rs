//! YAML that every version of YAML reads alike: block maps and lists, every text in quotes, numbers with a point.
//!
//! How it can be wrong: YAML 1.1, which PyYAML reads, takes `1e-5` for a text and `no` for false. Numbers therefore have a point and a signed exponent. Texts
//! and keys are in double quotes, in which JSON's escapes have the same meaning.

use super::node::Node;

/// The text.
pub(super) fn text(node: &Node) -> String {
    let mut out = String::new();
    write(node, 0, &mut out);
    if !out.ends_with('\n') {
        out.push('\n');
    }
    out
}

/// A value without a separate line.
fn scalar(node: &Node) -> Option<String> {
    Some(match node {
        Node::Null => "null".to_owned(),
        Node::Truth(truth) => truth.to_string(),
        Node::Whole(number) => number.to_string(),
        Node::Number(number) => float(*number),
        Node::Text(text) => quoted(text),
        Node::List(list) if list.is_empty() => "[]".to_owned(),
        Node::Map(entries) if entries.is_empty() => "{}".to_owned(),
        // Rows of numbers on one line, as people write them.
        Node::List(list) => {
            let all = list.iter().map(|one| {
                matches!(one, Node::Number(_) | Node::Whole(_) | Node::Null)
                    .then(|| scalar(one))
                    .flatten()
            });
            format!("[{}]", all.collect::<Option<Vec<_>>>()?.join(", "))
        }
        Node::Map(_) => return None,
    })
}

fn quoted(text: &str) -> String {
    serde_json::to_string(text).unwrap_or_default()
}

/// A key: unquoted where every reader takes it for a text.
fn key(text: &str) -> String {
    const WORDS: [&str; 9] = ["true", "false", "yes", "no", "on", "off", "null", "y", "n"];
    let plain = text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        && !WORDS.contains(&text.to_ascii_lowercase().as_str());
    if plain { text.to_owned() } else { quoted(text) }
}

fn float(number: f64) -> String {
    if !number.is_finite() {
        return "null".to_owned();
    }
    if number == 0.0 || (1e-6..1e15).contains(&number.abs()) {
        let text = number.to_string();
        return if text.contains('.') { text } else { format!("{text}.0") };
    }
    let text = format!("{number:e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let point = if mantissa.contains('.') { "" } else { ".0" };
    let sign = if exponent.starts_with('-') { "" } else { "+" };
    format!("{mantissa}{point}e{sign}{exponent}")
}

fn write(node: &Node, depth: usize, out: &mut String) {
    let indent = "  ".repeat(depth);
    match (scalar(node), node) {
        (Some(text), _) => out.push_str(&text),
        (None, Node::Map(entries)) => {
            for (at, (name, value)) in entries.iter().enumerate() {
                if at > 0 {
                    out.push_str(&indent);
                }
                out.push_str(&key(name));
                out.push(':');
                match scalar(value) {
                    Some(text) => {
                        out.push(' ');
                        out.push_str(&text);
                    }
                    None => {
                        out.push_str(&format!("\n{}", "  ".repeat(depth + 1)));
                        write(value, depth + 1, out);
                        continue;
                    }
                }
                out.push('\n');
            }
        }
        (None, Node::List(list)) => {
            for (at, one) in list.iter().enumerate() {
                if at > 0 {
                    out.push_str(&indent);
                }
                out.push_str("- ");
                write(one, depth + 1, out);
                if !out.ends_with('\n') {
                    out.push('\n');
                }
            }
        }
        (None, _) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_a_point_and_texts_stand_in_quotes() {
        let node = Node::map([
            ("small", Node::Number(1e-9)),
            ("large", Node::Number(-3e20)),
            ("whole", Node::Number(5.0)),
            ("steps", Node::Whole(5)),
            ("no", Node::from("no: \"quoted\"\n")),
            ("pair", Node::from(vec![0.5, 1.0])),
            (
                "deep",
                Node::List(vec![
                    Node::map([("a", Node::Null), ("b", Node::map([("c", true.into())]))]),
                    Node::from("x"),
                ]),
            ),
        ]);
        let expected = "small: 1.0e-9\nlarge: -3.0e+20\nwhole: 5.0\nsteps: 5\n\"no\": \"no: \\\"quoted\\\"\\n\"\npair: [0.5, 1.0]\n\
                        deep:\n  - a: null\n    b:\n      c: true\n  - \"x\"\n";
        assert_eq!(text(&node), expected);
    }
}
