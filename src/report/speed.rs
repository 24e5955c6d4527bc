//! The result of a gate on speed: as text, as Markdown, as JUnit XML.

use super::junit::escaped;
use super::study::{number, time};
use super::text::Table;
use deadtime_study::{Speed, SpeedReport, Timed};

/// One sentence: the comparison, and whether anything is slower.
#[must_use]
pub fn headline(report: &SpeedReport) -> String {
    let (slower, faster) = (report.of(Speed::Slower).count(), report.of(Speed::Faster).count());
    let pairs: usize = report.benches.iter().map(|b| b.pairs).sum();
    let standing = match (slower, faster) {
        (0, 0) => "nothing is slower".to_owned(),
        (0, f) => format!("nothing is slower, {f} faster"),
        (s, f) => format!("{s} slower, {f} faster"),
    };
    format!(
        "{} benches, {pairs} pairs of runs; slower is what takes {} % longer at least, by a test at {} % for all together: {standing}.",
        report.benches.len(),
        100.0 * report.margin,
        100.0 * report.alpha
    )
}

/// A bench in a line.
#[must_use]
pub fn line(bench: &Timed) -> String {
    let Timed {
        bench: name,
        pairs,
        minimum_s: [b, a],
        median_s: [mb, ma],
        ratio,
        beyond: [longer, shorter],
        p_value,
        speed,
    } = bench;
    let (count, p) =
        if *speed == Speed::Faster { (shorter, p_value[1]) } else { (longer, p_value[0]) };
    format!(
        "{name}: {} → {} (medians {} → {}), {} times, beyond the margin in {count} of {pairs} pairs, p = {}",
        time(Some(*b)),
        time(Some(*a)),
        time(Some(*mb)),
        time(Some(*ma)),
        number(Some(*ratio)),
        number(Some(p))
    )
}

/// For a terminal: the sentence, and a line for each bench that is not the same.
#[must_use]
pub fn text(report: &SpeedReport) -> String {
    let list = |word: &str, speed| {
        report.of(speed).map(|b| format!("  {word}: {}\n", line(b))).collect::<String>()
    };
    format!(
        "{}\n{}{}",
        headline(report),
        list("slower", Speed::Slower),
        list("faster", Speed::Faster)
    )
}

/// A page: the sentence, every bench, the worst first.
#[must_use]
pub fn markdown(report: &SpeedReport) -> String {
    let mut table = Table::new(
        &[
            "bench",
            "",
            "shortest before",
            "now",
            "median before",
            "now",
            "ratio",
            "beyond",
            "of",
            "p",
        ],
        &[0, 1],
    );
    let mut benches: Vec<&Timed> = report.benches.iter().collect();
    benches.sort_by(|a, b| b.ratio.total_cmp(&a.ratio));
    for b in benches {
        let word = match b.speed {
            Speed::Slower => "slower",
            Speed::Faster => "faster",
            Speed::Same => "",
        };
        let mut row = vec![b.bench.clone(), word.to_owned()];
        row.extend(b.minimum_s.iter().chain(&b.median_s).map(|s| time(Some(*s))));
        row.extend([
            number(Some(b.ratio)),
            b.beyond[0].to_string(),
            b.pairs.to_string(),
            number(Some(b.p_value[0])),
        ]);
        table.row(row);
    }
    format!(
        "# Speed\n\n{}\n\n`beyond`: pairs in which the new program took longer than the margin allows; p: the chance of so many, anywhere, between equally fast programs.\n\n{}",
        headline(report),
        table.markdown()
    )
}

/// JUnit XML: a test case per bench.
#[must_use]
pub fn junit(report: &SpeedReport) -> String {
    let (tests, failures) = (report.benches.len(), report.of(Speed::Slower).count());
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"deadtime gate: speed\" tests=\"{tests}\" failures=\"{failures}\" errors=\"0\">\n  \
         <testsuite name=\"speed\" tests=\"{tests}\" failures=\"{failures}\" errors=\"0\" skipped=\"0\">\n"
    );
    for bench in &report.benches {
        let head = format!("    <testcase classname=\"speed\" name=\"{}\"", escaped(&bench.bench));
        text += &match bench.speed {
            Speed::Slower => format!(
                "{head}>\n      <failure type=\"slower\" message=\"{}\"/>\n    </testcase>\n",
                escaped(&line(bench))
            ),
            Speed::Faster | Speed::Same => format!("{head}/>\n"),
        };
    }
    text + &format!(
        "  </testsuite>\n  <!-- {} -->\n</testsuites>\n",
        escaped(&headline(report)).replace("--", "- -")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use deadtime_study::{SpeedGate, TimedPair, Timings};

    #[test]
    fn every_format_names_the_slower_bench_with_its_numbers() {
        let pair = |bench: &str, after_s: f64| TimedPair {
            bench: bench.to_owned(),
            before_s: 1e-6,
            after_s,
        };
        let pairs = (0..12).flat_map(|_| [pair("a<b|c", 2e-6), pair("same", 1.01e-6)]).collect();
        let report = SpeedGate::default().judge(&Timings { pairs }).unwrap();
        assert!(
            text(&report)
                .contains("slower: a<b|c: 1.00 µs → 2.00 µs (medians 1.00 µs → 2.00 µs), 2.00 times, beyond the margin in 12 of 12 pairs"),
            "{}",
            text(&report)
        );
        assert!(!text(&report).contains("same"));
        let page = markdown(&report);
        assert!(
            page.contains("a\\<b\\|c")
                && page.contains("| same")
                && page.contains("1 slower, 0 faster"),
            "{page}"
        );
        let xml = junit(&report);
        assert!(
            xml.contains("tests=\"2\" failures=\"1\"")
                && xml.contains("name=\"a&lt;b|c\">")
                && xml.contains("name=\"same\"/>"),
            "{xml}"
        );
    }
}
