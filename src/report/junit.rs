//! What a gate found, as JUnit XML: one test suite per grid and place, one test case per method.

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
        let skipped = groups.iter().filter(|(_, g)| g.new).count();
        (groups.len(), failures, skipped)
    };
    let all: Vec<(usize, &GateGroup)> = report.groups.iter().enumerate().collect();
    let (tests, failures, _) = counts(&all);
    let mut text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n".to_owned();
    text += &format!(
        "<testsuites name=\"deadtime gate: {}\" tests=\"{tests}\" failures=\"{failures}\" errors=\"0\">\n",
        escaped(&report.plan)
    );
    for (name, groups) in suites {
        let (tests, failures, skipped) = counts(&groups);
        let suite = escaped(&name);
        text += &format!(
            "  <testsuite name=\"{suite}\" tests=\"{tests}\" failures=\"{failures}\" errors=\"0\" skipped=\"{skipped}\">\n"
        );
        for (at, group) in groups {
            let head = format!(
                "    <testcase classname=\"{}.{suite}\" name=\"{}\"",
                escaped(&report.plan),
                escaped(&group.method)
            );
            let worse = of(at);
            text += &match (group.new, worse.first()) {
                (true, _) => format!(
                    "{head}>\n      <skipped message=\"new: the baseline does not have it\"/>\n    </testcase>\n"
                ),
                (false, None) => format!("{head}/>\n"),
                (false, Some(first)) => {
                    let more = if worse.len() > 1 {
                        format!(" (and {} more)", worse.len() - 1)
                    } else {
                        String::new()
                    };
                    let lines: String = worse.iter().map(|f| line(f) + "\n").collect();
                    format!(
                        "{head}>\n      <failure type=\"worse\" message=\"{}\">{}</failure>\n    </testcase>\n",
                        escaped(&(line(first) + &more)),
                        escaped(&lines)
                    )
                }
            };
        }
        text += "  </testsuite>\n";
    }
    text + &format!(
        "  <!-- {} -->\n</testsuites>\n",
        escaped(&headline(report)).replace("--", "- -")
    )
}

/// Text as it may stand in XML 1.0, in an attribute too; what may not stand there at all becomes U+FFFD.
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
