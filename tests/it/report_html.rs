//! report.html: a page that stands by itself, says what the diagnosis says, and lets no name act on it.

use crate::support::program::{Folder, deadtime, text};
use deadtime::diagnose::Diagnosis;

/// Names that are markup; the second output is measured seldom, and both have a gap.
const MODEL: &str = r#"
format = "deadtime/model@1"
name = "<script>alert(1)</script>"
kind = "lti"
inputs = [{ name = "u<b>", unit = "V" }]
states = [{ name = "x", unit = "rad" }, { name = "v", unit = "rad/s" }]
outputs = [{ name = "angle & \"co\"", unit = "<i>rad" }, { name = "rate", unit = "rad/s" }]
initial = [0.0, 0.0]
initial_std = [0.01, 0.01]
A = [[0.0, 1.0], [-9.0, -2.4]]
B = [[0.0], [9.0]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"#;

/// The machine: the model with its command late by some samples, measured with a little noise.
fn log(samples: usize, late: usize) -> String {
    let mut out = String::from("time,u<b>,\"angle & \"\"co\"\"\",rate\n");
    let (mut x, mut v, mut noise) = (0.0_f64, 0.0_f64, 1_u64);
    let command = |k: usize| [0.6, -0.9, 0.2, 0.9, -0.4, -0.1, 0.7][(k / 35) % 7] * if (k / 245).is_multiple_of(2) { 1.0 } else { 0.7 };
    for k in 0..samples {
        // A linear congruential generator, uniform in ±0.02.
        let mut draw = || {
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            0.04 * ((noise >> 40) as f64 / (1_u64 << 24) as f64 - 0.5)
        };
        let (angle, rate) = (x + draw(), v + draw());
        let angle = if (300..380).contains(&k) { String::new() } else { angle.to_string() };
        let rate = if k % 10 == 0 { rate.to_string() } else { String::new() };
        out += &format!("{:.2},{},{angle},{rate}\n", k as f64 * 0.02, command(k));
        let u = command(k.saturating_sub(late));
        for _ in 0..20 {
            (x, v) = (x + 0.001 * v, v + 0.001 * (-9.0 * x - 2.4 * v + 9.0 * u));
        }
    }
    out
}

/// The page and the diagnosis of two training logs and a held-out one.
fn report(late: usize) -> (String, Diagnosis) {
    let folder = Folder::new();
    let model = folder.write("model.toml", MODEL);
    let logs = [("<img>.csv", 900), ("b.csv", 700), ("c.csv", 600)].map(|(name, samples)| folder.write(name, &log(samples, late)));
    let out = folder.path("out");
    let [a, b, c] = &logs;
    deadtime(&["gap", "--model", text(&model), "--log", text(a), "--log", text(b), "--holdout", text(c), "--out", text(&out)]).done();
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    (page, Diagnosis::read(&out.join("diagnosis.json")).unwrap())
}

/// Every element in order of appearance; fails where tags do not match, attributes are not quoted or a character stands that should be escaped.
fn elements(page: &str) -> Vec<String> {
    let mut rest = page.strip_prefix("<!doctype html>").expect("a doctype");
    let (mut open, mut all): (Vec<&str>, Vec<String>) = (Vec::new(), Vec::new());
    while let Some(start) = rest.find('<') {
        let between = &rest[..start];
        if open.last() != Some(&"style") {
            assert!(!between.contains('>'), "a bare > in {between:?}");
            for at in between.match_indices('&').map(|m| m.0) {
                let entity = &between[at..];
                assert!(["&amp;", "&lt;", "&gt;", "&quot;", "&#39;"].iter().any(|e| entity.starts_with(e)), "a bare & in {between:?}");
            }
        }
        let end = start + rest[start..].find('>').expect("a tag ends");
        let tag = &rest[start + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "the tag that closes");
            continue;
        }
        let name = tag.split([' ', '/']).next().unwrap();
        assert_eq!(tag.matches('"').count() % 2, 0, "quotes of {tag}");
        assert_eq!(tag.matches("=\"").count() * 2, tag.matches('"').count(), "attributes of {tag}");
        all.push(tag.to_owned());
        if !tag.ends_with('/') {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
    all
}

#[test]
fn the_page_is_well_formed_stands_alone_and_says_what_the_diagnosis_says() {
    let (page, d) = report(6);
    let all = elements(&page);
    let count = |name: &str| all.iter().filter(|tag| tag.split([' ', '/']).next() == Some(name)).count();
    // A picture per output, each with words for those who cannot see it.
    assert_eq!((count("figure"), count("svg"), count("figcaption")), (2, 2, 2));
    assert_eq!((count("html"), count("title") - count("svg"), count("h1"), count("desc")), (1, 1, 1, 2));
    // Three logs, two outputs: measured once, predicted and left over twice each, before and after.
    for (class, times) in [("measured", 6), ("before", 12), ("after", 12)] {
        assert_eq!(all.iter().filter(|tag| tag.starts_with(&format!("path class=\"{class}\""))).count(), times, "{class}");
    }
    assert_eq!(all.iter().filter(|tag| tag.starts_with("rect class=\"held\"")).count(), 2, "the held-out log, in each picture");
    // Nothing from elsewhere, nothing that acts.
    for foreign in ["http", "src=", "@import", "<script", "<link", "javascript:", "<img", "<i>"] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    assert!(all.iter().all(|tag| !tag.contains(" on")), "an event handler");
    for bad in ["NaN", "inf\"", "inf ", "Infinity", "null"] {
        assert!(!page.contains(bad), "{bad}");
    }
    assert!(page.contains("<title>Gap of &lt;script&gt;alert(1)&lt;/script&gt;: input_delay on u&lt;b&gt;</title>"));
    assert!(page.contains("angle &amp; &quot;co&quot;") && page.contains("&lt;img&gt;.csv") && page.contains("(&lt;i&gt;rad)"));
    assert!(page.contains("prefers-color-scheme:dark") && page.contains("@media print"));
    assert_eq!(d.cause.verdict, "input_delay");
    for name in d.cause.indistinguishable.iter().flatten() {
        assert!(page.contains(&format!("<code>{}</code>", name.replace('<', "&lt;").replace('>', "&gt;"))), "{name}");
    }
    for row in ["Gap:", "Place:", "Cause:", "Rivals:", "Shrink:"] {
        assert!(page.contains(&format!("<strong>{row}</strong>")), "{row}");
    }
    assert!(page.contains("What was found to act") && page.contains("Ranking") && page.contains("held out"));
}

#[test]
fn without_a_cause_nothing_is_drawn_as_explained() {
    let (page, d) = report(0);
    assert_eq!(d.cause.verdict, "none");
    let all = elements(&page);
    assert!(!all.iter().any(|tag| tag.contains("class=\"after\"") || tag.contains("key after")));
    assert!(page.contains("Verdict: <strong>none</strong>") && !page.contains("What was found to act"));
    assert_eq!(all.iter().filter(|tag| tag.starts_with("figure")).count(), 2);
}

#[test]
fn a_long_log_gives_a_small_page() {
    let folder = Folder::new();
    let model = folder.write(
        "model.toml",
        "format = \"deadtime/model@1\"\nname = \"m\"\nkind = \"lti\"\nsample_time_s = 0.02\ninputs = [{ name = \"u\" }]\nstates = [{ name = \"x\" }]\n\
         outputs = [{ name = \"y\" }]\nA = [[0.5]]\nB = [[0.5]]\nC = [[1.0]]\nD = [[0.0]]\n",
    );
    let mut lines = String::from("time,u,y\n");
    let (mut x, mut noise) = (0.0, 1_u64);
    for k in 0..20_000_u32 {
        noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let u = if noise >> 63 == 0 { -1.0 } else { 1.0 };
        lines += &format!("{:.2},{u},{}\n", f64::from(k) * 0.02, x + 1e-3 * f64::from((noise >> 40) as u32 % 1000));
        x = 0.5 * x + 0.5 * u;
    }
    let out = folder.path("out");
    deadtime(&["gap", "--model", text(&model), "--log", text(&folder.write("log.csv", &lines)), "--max-delay", "0.1", "--out", text(&out)])
        .done();
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    elements(&page);
    assert!(page.len() < 500_000, "{} bytes", page.len());
}
