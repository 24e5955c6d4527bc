//! Pages: each stands by itself, says what was found, holds the curves, and lets no name act on it.

use crate::support::program::{Folder, deadtime, text};
use deadtime::diagnose::Diagnosis;

/// Names that are markup; the second output is measured seldom, and both have a gap.
pub(crate) const MODEL: &str = r#"
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
pub(crate) fn log(samples: usize, late: usize) -> String {
    let mut out = String::from("time,u<b>,\"angle & \"\"co\"\"\",rate\n");
    let (mut x, mut v, mut noise) = (0.0_f64, 0.0_f64, 1_u64);
    let command = |k: usize| {
        [0.6, -0.9, 0.2, 0.9, -0.4, -0.1, 0.7][(k / 35) % 7]
            * if (k / 245).is_multiple_of(2) { 1.0 } else { 0.7 }
    };
    for k in 0..samples {
        // A linear congruential generator, uniform in ±0.02.
        let mut draw = || {
            noise = noise
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
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
    let logs = [("<img>.csv", 900), ("b.csv", 700), ("c.csv", 600)]
        .map(|(name, samples)| folder.write(name, &log(samples, late)));
    let out = folder.path("out");
    let [a, b, c] = &logs;
    deadtime(&[
        "gap",
        "--model",
        text(&model),
        "--log",
        text(a),
        "--log",
        text(b),
        "--holdout",
        text(c),
        "--out",
        text(&out),
    ])
    .done();
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    (page, Diagnosis::read(&out.join("diagnosis.json")).unwrap())
}

/// Elements that have no end.
const VOID: [&str; 3] = ["meta", "img", "br"];

/// Every element in order of appearance; fails where tags do not match, attributes are not quoted or a character stands that should be escaped.
pub(crate) fn elements(page: &str) -> Vec<String> {
    let mut rest = page.strip_prefix("<!DOCTYPE html>").expect("a doctype");
    let (mut open, mut all): (Vec<&str>, Vec<String>) = (Vec::new(), Vec::new());
    while let Some(start) = rest.find('<') {
        if open.last() == Some(&"script") {
            // What a script holds is no markup up to its end.
            let end = rest.find("</script>").expect("a script ends");
            rest = &rest[end + "</script>".len()..];
            open.pop();
            continue;
        }
        let between = &rest[..start];
        if open.last() != Some(&"style") {
            assert!(!between.contains('>'), "a bare > in {between:?}");
            for at in between.match_indices('&').map(|m| m.0) {
                let entity = &between[at..];
                assert!(
                    ["&amp;", "&lt;", "&gt;", "&quot;", "&#39;"]
                        .iter()
                        .any(|e| entity.starts_with(e)),
                    "a bare & in {between:?}"
                );
            }
        }
        let end = start + rest[start..].find('>').expect("a tag ends");
        let tag = &rest[start + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "the tag that closes");
            continue;
        }
        let name = tag.split(' ').next().unwrap();
        assert_eq!(tag.matches('"').count() % 2, 0, "quotes of {tag}");
        all.push(tag.to_owned());
        if !VOID.contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "left open: {open:?}");
    all
}

/// What the page's script draws.
pub(crate) fn drawn(page: &str) -> serde_json::Value {
    let (_, rest) =
        page.split_once("<script id=\"data\" type=\"application/json\">").expect("the data");
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

/// The page without its scripts and styles: what is read where no script runs.
pub(crate) fn read(page: &str) -> String {
    let mut text = page.split("<script").next().unwrap().to_owned();
    while let Some((before, rest)) = text.split_once("<style>") {
        text = format!("{before}{}", rest.split_once("</style>").unwrap().1);
    }
    // Folders of tests have random names, which may hold any letters.
    while let Some((before, rest)) = text.split_once("/.tmp") {
        text = format!("{before}{}", rest.chars().skip(6).collect::<String>());
    }
    text
}

#[test]
fn the_page_is_well_formed_stands_alone_and_says_what_the_diagnosis_says() {
    let (page, d) = report(6);
    let all = elements(&page);
    let count = |name: &str| all.iter().filter(|tag| tag.split(' ').next() == Some(name)).count();
    assert_eq!(
        (count("html"), count("title"), count("h1"), count("script"), count("style")),
        (1, 1, 1, 3, 1)
    );
    // Nothing from elsewhere, and nothing that acts but the page's own two scripts, whose digests its policy names.
    let read = read(&page);
    for foreign in
        ["src=", "@import", "<link", "javascript:", "<img", "<i>", "<iframe", "http:", "https:"]
    {
        assert!(!read.contains(foreign), "{foreign}");
    }
    assert!(
        !all.iter()
            .flat_map(|tag| tag.split(' '))
            .any(|word| word.starts_with("on") && word.contains("=\"")),
        "an event handler"
    );
    let policy = all.iter().find(|tag| tag.contains("Content-Security-Policy")).expect("a policy");
    assert!(
        policy.contains("default-src 'none'")
            && policy.matches("'sha256-").count() == 2
            && !policy.contains("script-src 'unsafe"),
        "{policy}"
    );
    for bad in ["NaN", "inf\"", "inf ", "Infinity", "null"] {
        let around = read.split(bad).map(|part| {
            part.chars().rev().take(200).collect::<Vec<_>>().into_iter().rev().collect::<String>()
        });
        assert!(!read.contains(bad), "{bad} behind {:?}", around.collect::<Vec<_>>());
    }
    assert!(page.contains(
        "<title>Gap of &lt;script&gt;alert(1)&lt;/script&gt;: input delay of u&lt;b&gt;</title>"
    ));
    assert!(read.contains("angle &amp; &quot;co&quot;") && read.contains("&lt;img&gt;.csv"));
    assert!(page.contains("prefers-color-scheme:dark") && page.contains("@media print"));
    assert_eq!(d.cause.verdict, "input_delay");
    for name in d.cause.indistinguishable[0].iter().skip(1) {
        let (effect, channel) = name.split_once(':').unwrap();
        let words = deadtime::diagnose::in_words(effect, channel).replace('`', "");
        let escaped = words.replace('<', "&lt;").replace('>', "&gt;");
        assert!(page.contains(&escaped), "{words}");
    }
    for tile in ["Error on held-out data", "Cause", "Probability", "Residual"] {
        assert!(page.contains(&format!("<span class=\"faint\">{tile}</span>")), "{tile}");
    }
    for row in ["Gap:", "Place:", "Cause:", "Left:", "Shrink:"] {
        assert!(page.contains(&format!("<strong>{row}</strong>")), "{row}");
    }
    assert!(
        read.contains("What was found to act")
            && read.contains("Each candidate alone")
            && read.contains("the budget of the gap")
    );
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
}

#[test]
fn the_curves_are_those_of_the_diagnosis_and_names_in_them_are_data() {
    let (page, _) = report(6);
    let data = drawn(&page);
    let logs = data["logs"].as_array().unwrap();
    let named: Vec<&str> = logs.iter().map(|l| l["name"].as_str().unwrap()).collect();
    assert!(
        named.len() == 3 && named[0].ends_with("<img>.csv") && named[2].ends_with("c.csv"),
        "{named:?}"
    );
    assert!(logs[2]["held"].is_array() && logs[0]["held"].is_null(), "the third was held out");
    for (log, samples) in logs.iter().zip([900, 700, 600]) {
        assert_eq!(log["time"]["count"], samples);
        assert!((log["time"]["step"].as_f64().unwrap() - 0.02).abs() < 1e-9);
        let outputs = log["outputs"].as_array().unwrap();
        assert_eq!(
            outputs.iter().map(|o| o["name"].as_str().unwrap()).collect::<Vec<_>>(),
            ["angle & \"co\"", "rate"]
        );
        assert_eq!(log["inputs"][0]["name"], "u<b>");
        for curve in [
            &outputs[0]["measured"],
            &outputs[0]["before"],
            &outputs[0]["after"],
            &log["inputs"][0]["values"],
        ] {
            // Two bytes a sample, four letters for three bytes.
            assert_eq!(
                curve["u16"].as_str().unwrap().len(),
                (2 * samples as usize).div_ceil(3) * 4
            );
            assert!(curve["low"].as_f64().unwrap() < curve["high"].as_f64().unwrap());
        }
        assert!(outputs[0]["floor"].as_f64().unwrap() > 0.0);
    }
    // The text of the data names nothing that could end it.
    let text = page.split("application/json\">").nth(1).unwrap().split("</script>").next().unwrap();
    assert!(!text.contains('<') && text.contains("\\u003c"));
}

#[test]
fn without_a_cause_nothing_is_drawn_as_explained() {
    let (page, d) = report(0);
    assert_eq!(d.cause.verdict, "none");
    let all = elements(&page);
    assert!(!all.iter().any(|tag| tag.contains("key after")));
    assert!(
        page.contains("<strong>none</strong>")
            && !page.contains("What was found to act")
            && !page.contains("the budget of the gap")
    );
    assert!(drawn(&page)["logs"][0]["outputs"][0]["after"].is_null());
}

#[test]
#[ignore = "nightly: a long log"]
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
        noise =
            noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let u = if noise >> 63 == 0 { -1.0 } else { 1.0 };
        lines += &format!(
            "{:.2},{u},{}\n",
            f64::from(k) * 0.02,
            x + 1e-3 * f64::from((noise >> 40) as u32 % 1000)
        );
        x = 0.5 * x + 0.5 * u;
    }
    let out = folder.path("out");
    deadtime(&[
        "gap",
        "--model",
        text(&model),
        "--log",
        text(&folder.write("log.csv", &lines)),
        "--max-delay",
        "0.1",
        "--out",
        text(&out),
    ])
    .done();
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    elements(&page);
    assert!(page.len() < 500_000, "{} bytes", page.len());
}

#[test]
fn the_page_of_an_estimate_holds_its_curves_and_every_method() {
    let folder = Folder::new();
    let mut log = String::from("time,<script>alert(1)</script>,y [V]\n");
    let mut past = [0.0; 4];
    for k in 0..300_u32 {
        let u = f64::from((k.wrapping_mul(2_654_435_761) >> 13) & 1);
        let noise = f64::from((k.wrapping_mul(2_246_822_519) >> 16) & 1023) / 10_230.0;
        log += &format!("{:.1},{u},{}\n", f64::from(k) * 0.1, past[0] + noise);
        past = [past[1], past[2], past[3], u];
    }
    let (log, page) = (folder.write("log.csv", &log), folder.path("answer.html"));
    let methods = ["--method", "arxstruc", "--method", "oestruc", "--method", "threshold"];
    let words = [
        "estimate",
        text(&log),
        "--input",
        "<script>alert(1)</script>",
        "--output",
        "y",
        "--html",
        text(&page),
    ];
    deadtime(&[&words[..], &methods[..]].concat()).done();
    let page = std::fs::read_to_string(page).unwrap();
    elements(&page);
    let read = read(&page);
    for part in [
        "Dead time",
        "arxstruc",
        "oestruc",
        "threshold",
        "&lt;script&gt;alert(1)&lt;/script&gt; → y",
    ] {
        assert!(read.contains(part), "{part}");
    }
    assert!(!page.contains("<script>alert"));
    let data = drawn(&page);
    let pair = &data["logs"][0]["pairs"][0];
    assert_eq!(
        (pair["input"].as_str(), pair["unit_y"].as_str()),
        (Some("<script>alert(1)</script>"), Some("V"))
    );
    assert!(pair["delay_s"].as_f64().is_some_and(|d| (d - 0.3).abs() < 0.11), "{pair}");
    assert!(page.len() < 400_000, "{} bytes", page.len());
    // What the methods look at: y follows u by four samples, and the answer of arxstruc stands on its curve.
    let views = data["figures"][0]["views"].as_array().unwrap();
    let curves: Vec<&str> = views.iter().map(|v| v["keys"][1].as_str().unwrap()).collect();
    assert_eq!(
        curves,
        [
            "impulse response",
            "loss over the delay",
            "probability of the delay",
            "correlation",
            "phase"
        ]
    );
    let [loss, answer] = [0, 1].map(|at| &views[1]["curves"][at]["y"]);
    assert_eq!(
        (&views[1]["x"]["values"][4], &loss[4], &answer[4]),
        (&serde_json::json!(0.4), &serde_json::json!(1.0), &serde_json::json!(1.0))
    );
    assert_eq!(answer.as_array().unwrap().iter().filter(|v| !v.is_null()).count(), 1);
    assert!(!read.contains("null"));
}
