//! Which effects an excitation makes distinguishable, as a table.

use super::styled::{WIDTH, wrapped};
use super::text::{Table, unit};
use deadtime_gap::{Isolability, Size};

/// Every effect with the smallest size that would be detected and its closest alternative, then the groups that look alike.
#[must_use]
pub fn text(found: &Isolability) -> String {
    let mode = found.prediction.words();
    let mut table = Table::new(
        &["effect", "channel", "seen from", "closest alternative", "cosine"],
        &[0, 1, 2, 3],
    );
    for e in &found.effects {
        let seen = e.smallest.as_ref().map_or_else(|| "not visible".to_owned(), size);
        let (rival, cosine) = e
            .rival
            .as_ref()
            .map_or_else(Default::default, |r| (r.name.clone(), format!("{:.3}", r.cosine)));
        table.row(vec![e.effect.clone(), e.channel.clone(), seen, rival, cosine]);
    }
    let visible = found.effects.iter().filter(|e| e.visible).count();
    let first = format!(
        "{} ({mode}) on {}: {visible} of {} effects are visible at a plausible size (twice the log-likelihood {} or more).",
        found.model,
        found.logs.join(", "),
        found.effects.len(),
        found.visible_from
    );
    let lines = |text: &str, indent: usize| wrapped(text, WIDTH, indent).join("\n");
    let mut text = format!("{}\n\n{}\n", lines(&first, 2), table.fit(WIDTH));
    if found.classes.is_empty() {
        text += &format!("No two of them look alike (cosine {} or more).\n", found.alike_from);
    } else {
        text +=
            &format!("Indistinguishable in these logs (cosine {} or more):\n", found.alike_from);
    }
    for class in &found.classes {
        let (members, next) =
            (format!("  {}", class.members.join(", ")), format!("    {}", class.next_experiment));
        text += &format!("{}\n{}\n", lines(&members, 4), lines(&next, 4));
    }
    text
}

/// A size for a reader: the change of a parameter that is not 0 by nature, the limit itself.
fn size(s: &Size) -> String {
    let unit = unit(&s.unit);
    match s.nominal {
        None => format!("{} {:.3e}{unit} and tighter", s.parameter, s.value),
        Some(0.0) => format!("{} {:.2e}{unit}", s.parameter, s.value.abs()),
        Some(nominal) => {
            format!("{} {nominal:.4} ± {:.2e}{unit}", s.parameter, (s.value - nominal).abs())
        }
    }
}
