//! The house: the order of the folders of diagnosis, and no circles of files, read from `use` lines.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The stages; a folder imports only from itself and from those before it.
const ORDER: [&str; 10] = ["format", "input", "baseline", "checks", "likelihood", "hypothesis", "search", "judge", "compose", "answer"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src/diagnose")
}

/// Every file of the folders as `folder::file` with its text, unit tests left out; and the texts of the `mod.rs`.
fn files() -> (BTreeMap<String, String>, Vec<(String, String)>) {
    let (mut files, mut mods) = (BTreeMap::new(), Vec::new());
    for folder in ORDER {
        for entry in std::fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let text = std::fs::read_to_string(&path).unwrap();
            let text = text.split("#[cfg(test)]\nmod ").next().unwrap().to_owned();
            match path.file_stem().unwrap().to_str().unwrap() {
                "mod" => mods.push((folder.to_owned(), text)),
                file => {
                    files.insert(format!("{folder}::{file}"), text);
                }
            }
        }
    }
    (files, mods)
}

/// `a::{b, c::{d, e}}` as `a::b`, `a::c::d`, `a::c::e`.
fn expanded(tree: &str) -> Vec<String> {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else { return vec![tree.to_owned()] };
    let (prefix, inside) = (&tree[..open], tree[open + 1..].trim_end().strip_suffix('}').unwrap());
    let (mut parts, mut depth, mut from) = (Vec::new(), 0, 0);
    for (at, letter) in inside.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&inside[from..at]);
                from = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&inside[from..]);
    let parts = parts.into_iter().filter(|p| !p.trim().is_empty());
    parts
        .flat_map(expanded)
        .map(|part| if part == "self" { prefix.trim_end_matches("::").to_owned() } else { format!("{prefix}{part}") })
        .collect()
}

/// The paths of all imports of a text.
fn imports(text: &str) -> Vec<String> {
    let (mut found, mut open) = (Vec::new(), String::new());
    for line in text.lines().map(str::trim_start) {
        let begins = line.strip_prefix("pub use ").or_else(|| line.strip_prefix("use "));
        match (begins, open.is_empty()) {
            (Some(begun), true) => open.push_str(begun),
            (_, false) => open.push_str(line),
            _ => continue,
        }
        if let Some((tree, _)) = open.split_once(';') {
            found.extend(expanded(tree));
            open.clear();
        }
    }
    found
}

/// What one file imports of the house, as `folder::file`, or what is wrong with an import.
fn targets(folder: &str, text: &str, files: &BTreeMap<String, String>) -> Result<BTreeSet<String>, String> {
    let mut found = BTreeSet::new();
    for import in imports(text) {
        let path = match (import.strip_prefix("crate::diagnose::"), import.strip_prefix("super::")) {
            (Some(path), _) => path.to_owned(),
            (_, Some(path)) => format!("{folder}::{path}"),
            _ => continue,
        };
        let mut parts = path.split("::");
        let target = format!("{}::{}", parts.next().unwrap_or(""), parts.next().unwrap_or(""));
        if !files.contains_key(&target) {
            return Err(format!("`{import}` is no item of a file"));
        }
        found.insert(target);
    }
    Ok(found)
}

#[test]
fn a_folder_of_diagnosis_imports_only_from_those_before_it() {
    let (files, _) = files();
    let mut wrong = Vec::new();
    for (file, text) in &files {
        let folder = file.split("::").next().unwrap();
        let place = |folder: &str| ORDER.iter().position(|f| *f == folder);
        match targets(folder, text, &files) {
            Err(why) => wrong.push(format!("{file}: {why}")),
            Ok(targets) => {
                let after = targets.iter().filter(|t| place(t.split("::").next().unwrap()) > place(folder));
                wrong.extend(after.map(|target| format!("{file} imports {target}, which comes after it")));
            }
        }
        let code: Vec<&str> = text.lines().filter(|l| !l.trim_start().starts_with("//") && !l.contains("use ")).collect();
        let inline =
            code.iter().filter(|l| l.contains("super::") || l.replace("pub(in crate::diagnose)", "").contains("crate::diagnose::"));
        wrong.extend(inline.map(|line| format!("{file} names a path without importing it: {}", line.trim())));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_files_of_diagnosis_import_each_other_in_a_circle() {
    let (files, _) = files();
    let graph: BTreeMap<&String, BTreeSet<String>> =
        files.iter().map(|(file, text)| (file, targets(file.split("::").next().unwrap(), text, &files).unwrap())).collect();
    let circle = circle(&graph);
    assert!(circle.is_empty(), "files that import each other in a circle, or what imports them: {circle:?}");
}

/// Files that import each other in a circle, and what imports them.
fn circle<'g>(graph: &BTreeMap<&'g String, BTreeSet<String>>) -> BTreeSet<&'g String> {
    // What imports nothing that is left goes, until nothing goes: a circle stays.
    let mut left: BTreeSet<&String> = graph.keys().copied().collect();
    loop {
        let free: Vec<&String> = left.iter().copied().filter(|f| graph[*f].iter().all(|t| !left.contains(t))).collect();
        if free.is_empty() {
            return left;
        }
        free.iter().for_each(|f| {
            left.remove(*f);
        });
    }
}

/// What a file of a flat folder of the crate imports of its neighbours, by their names, or what is wrong with an import.
fn neighbours(folder: &str, text: &str, files: &BTreeMap<String, String>) -> Result<BTreeSet<String>, String> {
    let own = format!("crate::{folder}::");
    let mut found = BTreeSet::new();
    for import in imports(text) {
        let Some(path) = import.strip_prefix(&own).or_else(|| import.strip_prefix("super::")) else { continue };
        let target = path.split("::").next().unwrap_or("").to_owned();
        if !files.contains_key(&target) {
            return Err(format!("`{import}` is no item of a file"));
        }
        found.insert(target);
    }
    let code =
        text.lines().filter(|l| !l.trim_start().starts_with("//") && !l.trim_start().starts_with("use ") && !l.starts_with("pub use "));
    match code.into_iter().find(|l| l.replace("pub(in crate", "").contains(&own) || l.contains("super::")) {
        Some(line) => Err(format!("it names a path without importing it: {}", line.trim())),
        None => Ok(found),
    }
}

/// Every file of a folder but its mod file, by name; a folder in it counts as one file, and what that imports of its own is left out.
fn flat_files(folder: &std::path::Path) -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let own = |line: &&str| !line.contains("super::") && !line.contains(&format!("::{name}::"));
        let text = match path.is_dir() {
            false => code_of(&path),
            true => {
                let inner =
                    std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "rs"));
                let texts: Vec<String> = inner.map(|p| code_of(&p)).collect();
                texts.iter().flat_map(|t| t.lines()).filter(own).fold(String::new(), |all, line| all + line + "\n")
            }
        };
        if name != "mod" {
            files.insert(name, text);
        }
    }
    files
}

fn code_of(path: &std::path::Path) -> String {
    std::fs::read_to_string(path).unwrap().split("#[cfg(test)]\nmod ").next().unwrap().to_owned()
}

#[test]
fn no_files_of_flat_folders_import_each_other_in_a_circle_or_through_their_mod_file() {
    for folder in ["report", "blind", "python"] {
        let files = flat_files(&root().parent().unwrap().join(folder));
        let (mut graph, mut wrong) = (BTreeMap::new(), Vec::new());
        for (file, text) in &files {
            match neighbours(folder, text, &files) {
                Ok(targets) => {
                    graph.insert(file, targets);
                }
                Err(why) => wrong.push(format!("{folder}/{file}.rs: {why}")),
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        let circle = circle(&graph);
        assert!(circle.is_empty(), "files of {folder} that import each other in a circle, or what imports them: {circle:?}");
    }
}

#[test]
fn a_mod_file_of_diagnosis_only_names_its_files() {
    let (_, mut mods) = files();
    mods.push(("diagnose".to_owned(), std::fs::read_to_string(root().join("mod.rs")).unwrap()));
    for (folder, text) in mods {
        let code = text.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
        for statement in code.split(';').map(str::trim).filter(|s| !s.is_empty()) {
            let statement = statement.trim_start_matches("#[cfg(test)]").trim_start();
            let plain = statement.trim_start_matches("pub(in crate::diagnose) ").trim_start_matches("pub(super) ");
            assert!(
                plain.starts_with("mod ") || plain.starts_with("pub use "),
                "{folder}/mod.rs does more than name its files: {statement}"
            );
        }
    }
}

/// Effects and their parameters say what they are (`lateness`, `role`); a name in the code would leave out the next effect of the kind.
#[test]
fn diagnosis_matches_no_name_of_an_effect_or_of_its_parameters() {
    let names: BTreeSet<&str> = deadtime::effect::EFFECTS.iter().map(|e| e.name()).collect();
    let (files, _) = files();
    let quoted = |text: &str| -> Vec<String> {
        let code = text.lines().filter(|l| !l.trim_start().starts_with("//") && !l.contains("#["));
        code.flat_map(|l| l.split('"').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>()).collect()
    };
    assert_eq!(quoted("let a = \"input_delay\"; // b\n// \"no\"\n"), ["input_delay"]);
    let wrong: Vec<String> = files
        .iter()
        .flat_map(|(file, text)| quoted(text).into_iter().filter(|q| names.contains(q.as_str())).map(move |q| format!("{file} names {q}")))
        .collect();
    assert!(files.len() > 70 && names.len() > 30);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The reader of imports itself: what it must catch.
#[test]
fn imports_are_read_whatever_their_form() {
    let text = "//! use crate::diagnose::a::b;\nuse crate::diagnose::judge::{floor::{self, Floor}, verdict::judge};\nuse super::noise::Noise;\nfn f() {}\n";
    let found = imports(text);
    let expected = [
        "crate::diagnose::judge::floor",
        "crate::diagnose::judge::floor::Floor",
        "crate::diagnose::judge::verdict::judge",
        "super::noise::Noise",
    ];
    assert_eq!(found, expected);
    let files = BTreeMap::from([("judge::floor".to_owned(), String::new())]);
    assert!(targets("judge", "use crate::diagnose::GapError;\n", &files).is_err());
    assert!(targets("judge", "use super::super::floor::Floor;\n", &files).is_err());
    assert_eq!(targets("judge", "use super::floor::Floor;\n", &files).unwrap().len(), 1);
    let files = BTreeMap::from([("text".to_owned(), String::new())]);
    assert!(neighbours("report", "use super::Table;\n", &files).is_err());
    assert!(neighbours("report", "fn f() { super::text::table(); }\n", &files).is_err());
    assert_eq!(neighbours("report", "use crate::report::text::Table;\n", &files).unwrap().len(), 1);
    let (a, b, c) = ("a".to_owned(), "b".to_owned(), "c".to_owned());
    let graph = BTreeMap::from([(&a, BTreeSet::from([b.clone()])), (&b, BTreeSet::from([a.clone()])), (&c, BTreeSet::new())]);
    assert_eq!(circle(&graph), BTreeSet::from([&a, &b]));
}
