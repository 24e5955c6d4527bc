//! The result of a gate, as JUnit XML: one test suite per grid and place, one test case per method.

use super::gate::{headline, line};
use deadtime_study::{Finding, GateGroup, GateReport};

/// The whole file.
#[must_use]
pub fn xml(report: &GateReport) -> String {
    let mut suites: Vec<(String, Vec<(usize, &GateGroup)>)> = Vec::new();
    for (at, group) in report.groups.iter().enumerate() {
        let name = format!("{}, from {}", group.grid, group.place.name());
        match suites.iter_mut().find(|(n, _)| *n == name) {
            Some((_, groups)) => groups.push((at, group)),
            None => suites.push((name, vec![(at, group)])),
        }
    }
    let of = |at: usize| report.worse.iter().filter(|f| f.group == at).collect::<Vec<&Finding>>();
    let counts = |groups: &[(usize, &GateGroup)]| {
        let failures = groups.iter().filter(|(at, _)| !of(*at).is_empty()).count();
        format!("tests=\"{}\" failures=\"{failures}\" errors=\"0\"", groups.len())
    };
    let all: Vec<(usize, &GateGroup)> = report.groups.iter().enumerate().collect();
    let plan = escaped(&report.plan);
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"deadtime gate: {plan}\" {}>\n",
        counts(&all)
    );
    for (name, groups) in suites {
        let suite = escaped(&name);
        let skipped = groups.iter().filter(|(_, g)| g.new).count();
        text +=
            &format!("  <testsuite name=\"{suite}\" {} skipped=\"{skipped}\">\n", counts(&groups));
        for (at, group) in groups {
            text += &format!(
                "    <testcase classname=\"{plan}.{suite}\" name=\"{}\"{}\n",
                escaped(&group.method),
                outcome(group.new, &of(at))
            );
        }
        text += "  </testsuite>\n";
    }
    text + &format!(
        "  <!-- {} -->\n</testsuites>\n",
        escaped(&headline(report)).replace("--", "- -")
    )
}

/// The end of a test case: new, as good as before, or worse.
fn outcome(new: bool, worse: &[&Finding]) -> String {
    match (new, worse) {
        (true, _) => {
            ">\n      <skipped message=\"new: the baseline does not have it\"/>\n    </testcase>"
                .to_owned()
        }
        (false, []) => "/>".to_owned(),
        (false, [first, others @ ..]) => {
            let more = match others.len() {
                0 => String::new(),
                count => format!(" (and {count} more)"),
            };
            let lines: String = worse.iter().map(|f| line(f) + "\n").collect();
            format!(
                ">\n      <failure type=\"worse\" message=\"{}\">{}</failure>\n    </testcase>",
                escaped(&(line(first) + &more)),
                escaped(&lines)
            )
        }
    }
}

/// Text escaped for XML 1.0, in an attribute too; forbidden characters become U+FFFD.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&apos;",
            '\n' | '\t' => out.push(c),
            c if c < ' ' || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn what_xml_may_not_hold_does_not_get_there() {
        assert_eq!(
            escaped("a<b & \"c\" '\u{1}\u{8}d\u{ffff}>\n"),
            "a&lt;b &amp; &quot;c&quot; &apos;\u{fffd}\u{fffd}d\u{fffd}&gt;\n"
        );
    }
}
