//! Text that others wrote (names, cells, messages), made safe to show.
//!
//! A terminal obeys control characters, and Markdown its own marks: what comes from a file, a model or a plan is data and does neither.

/// Characters of a name or cell that are shown.
const LONGEST: usize = 200;
/// Characters of a line of a message that are shown: several names and the sentence around them.
const LINE: usize = 2000;

/// A character that moves the cursor, colours, hides or reorders what follows, or breaks the line.
fn commands(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{ad}' | '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}')
}

/// Appends a character, one that commands as its escape.
fn push(text: &mut String, c: char) {
    if commands(c) { text.extend(c.escape_default()) } else { text.push(c) }
}

fn cut(text: &str, longest: usize) -> String {
    let mut safe = String::with_capacity(text.len().min(4 * longest));
    let mut characters = text.chars();
    characters.by_ref().take(longest).for_each(|c| push(&mut safe, c));
    if characters.next().is_some() {
        safe.push('…');
    }
    safe
}

/// A name, a cell or another text of one line: control characters as their escapes, at most 200 characters and an ellipsis.
///
/// ```
/// use deadtime_signal::text::shown;
/// assert_eq!(shown("thrust \u{1b}[31m\n"), "thrust \\u{1b}[31m\\n");
/// ```
#[must_use]
pub fn shown(text: &str) -> String {
    cut(text, LONGEST)
}

/// A number with its standard deviation, both with two digits of that: `1.30 ± 0.21`.
///
/// ```
/// use deadtime_signal::text::plus_minus;
/// assert_eq!(plus_minus(1.3042, 0.213), "1.30 ± 0.21");
/// assert_eq!(plus_minus(-412.3, 17.0), "-412 ± 17");
/// ```
#[must_use]
pub fn plus_minus(value: f64, std: f64) -> String {
    let place = if std > 0.0 && std.is_finite() { std.log10().floor() } else { 0.0 };
    let digits = (1.0 - place).clamp(0.0, 15.0) as usize;
    if digits <= 8 {
        format!("{value:.digits$} ± {std:.digits$}")
    } else {
        format!("{value:e} ± {std:.1e}")
    }
}

/// A message as one paragraph: line breaks stay, blank lines go, other control characters are shown as their escapes, and long lines are cut.
#[must_use]
pub fn message(text: &str) -> String {
    let lines = text.lines().filter(|l| !l.trim().is_empty()).map(|l| cut(l, LINE));
    lines.collect::<Vec<_>>().join("\n")
}

/// Text for a terminal: line breaks and blank lines stay, other control characters are shown as their escapes.
#[must_use]
pub fn printed(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    text.chars().for_each(|c| if c == '\n' { safe.push(c) } else { push(&mut safe, c) });
    safe
}

/// The same inside Markdown, also in a table: nothing in it is markup.
///
/// ```
/// use deadtime_signal::text::markdown;
/// assert_eq!(markdown("a|b <script> `x`"), "a\\|b \\<script> \\`x\\`");
/// ```
#[must_use]
pub fn markdown(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '|' | '<' | '`' | '\\' => safe.extend(['\\', c]),
            // The escape's own backslash is to be seen.
            c if commands(c) => safe.extend(['\\'].into_iter().chain(c.escape_default())),
            c => safe.push(c),
        }
    }
    safe
}

/// A parser's message about a text, with its line: `line 3, column 5: …`, in one line.
#[must_use]
pub fn located(text: &str, at: Option<usize>, message: &str) -> String {
    let message =
        message.lines().map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join("; ");
    match at.and_then(|at| text.get(..at)) {
        Some(before) => {
            let line = before.matches('\n').count() + 1;
            let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
            format!("line {line}, column {column}: {message}")
        }
        None => message,
    }
}

/// ` (did you mean …?)` of the closest name; empty where none is near.
#[must_use]
pub fn did_you_mean<'a>(wanted: &str, names: impl Iterator<Item = &'a str> + Clone) -> String {
    closest(wanted, names).map_or_else(String::new, |name| format!(" (did you mean `{name}`?)"))
}

/// Letters from which a word may be the beginning of a name.
const BEGINS: usize = 2;

/// The name that a mistyped name may mean, capitals ignored. It is the shortest that begins with it, else the nearest by edit distance, unless more than half
/// of the letters differ.
pub fn closest<'a>(wanted: &str, names: impl Iterator<Item = &'a str> + Clone) -> Option<&'a str> {
    let lower = wanted.to_lowercase();
    let wanted: Vec<char> = lower.chars().collect();
    let begun = names.clone().filter(|name| name.to_lowercase().starts_with(&lower));
    if let Some(name) = begun.filter(|_| wanted.len() >= BEGINS).min_by_key(|name| name.len()) {
        return Some(name);
    }
    names
        .map(|name| {
            let letters: Vec<char> = name.to_lowercase().chars().collect();
            (edit_distance(&wanted, &letters), wanted.len().max(letters.len()), name)
        })
        .filter(|(distance, length, _)| 2 * distance <= *length)
        .min_by_key(|(distance, _, _)| *distance)
        .map(|(_, _, name)| name)
}

/// Insertions, deletions and substitutions that lead from `a` to `b` (Levenshtein 1966), row by row.
fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut above: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut row = Vec::with_capacity(above.len());
        let mut left = i + 1;
        row.push(left);
        for (y, (diagonal, up)) in
            b.iter().zip(above.windows(2).filter_map(|w| Some((*w.first()?, *w.last()?))))
        {
            left = (diagonal + usize::from(x != y)).min(up + 1).min(left + 1);
            row.push(left);
        }
        above = row;
    }
    above.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_is_long_is_cut_with_an_ellipsis() {
        assert_eq!(shown(&"x".repeat(200)), "x".repeat(200));
        assert_eq!(shown(&"é".repeat(201)), "é".repeat(200) + "…");
        assert_eq!(message("a\n\n\u{7}b\r\n"), "a\n\\u{7}b");
        assert_eq!(printed("a\n\nb\u{9b}2J\u{202e}"), "a\n\nb\\u{9b}2J\\u{202e}");
    }

    #[test]
    fn a_place_in_a_text_is_told_by_line_and_column() {
        assert_eq!(
            located("a = 1\nb = \n", Some(10), "no value\nwanted"),
            "line 2, column 5: no value; wanted"
        );
        assert_eq!(located("a", None, "wrong"), "wrong");
        assert_eq!(located("a", Some(9), "wrong"), "wrong");
    }

    proptest! {
        #[test]
        fn nothing_that_commands_is_left(text in any::<String>()) {
            prop_assert!(!shown(&text).chars().any(commands));
            prop_assert!(!message(&text).chars().any(|c| c != '\n' && commands(c)) && !message(&text).contains("\n\n"));
            prop_assert!(!printed(&text).chars().any(|c| c != '\n' && commands(c)));
            prop_assert!(!markdown(&text).chars().any(commands));
        }
    }
}
