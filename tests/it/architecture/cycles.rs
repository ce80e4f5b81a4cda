//! Cycles of imports between the files of one top-level module.
//!
//! A file depends on the file that defines what it names by `crate::`, `super::`, `self::` or by a
//! submodule's name. A re-export (`pub use`) is followed to the definition and is no dependency.
//! Tests inside of files do not count.
use std::collections::{BTreeMap, BTreeSet};

use super::source::{Source, sources};

type Path = Vec<String>;

/// How many files there still are in cycles. This number may only become smaller.
const FILES_IN_CYCLES: usize = 24;

/// Code without comments, texts and the tests at a file's end.
fn bare(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let mut out = String::new();
    for line in code.lines().filter(|line| !line.trim_start().starts_with("//")) {
        for (part, piece) in line.split('"').enumerate() {
            if part % 2 == 0 {
                out.push_str(piece.split(" // ").next().unwrap_or_default());
            }
            out.push(' ');
        }
        out.push('\n');
    }
    out
}

/// `a::{b, c::{d, e}}` as `a::b`, `a::c::d`, `a::c::e`; `x as y` as `x`.
fn expand(tree: &str) -> Vec<Path> {
    let tree = tree.trim();
    let Some((head, rest)) = tree.split_once('{') else {
        let name = tree.split(" as ").next().unwrap_or_default();
        return vec![name.split("::").map(|part| part.trim().to_string()).collect()];
    };
    let head: Path =
        head.split("::").map(str::trim).filter(|part| !part.is_empty()).map(String::from).collect();
    let inside = rest.rsplit_once('}').map_or(rest, |(inside, _)| inside);
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for c in inside.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ',' && depth == 0 {
            parts.push(String::new());
        } else if let Some(part) = parts.last_mut() {
            part.push(c);
        }
    }
    let whole = |path: Path| head.iter().cloned().chain(path).collect::<Path>();
    parts.iter().filter(|p| !p.trim().is_empty()).flat_map(|p| expand(p)).map(whole).collect()
}

/// What a file names: paths of its imports, paths in its code, and paths that it re-exports.
struct Named {
    used: Vec<Path>,
    exported: Vec<Path>,
}

fn named(text: &str) -> Named {
    let code = bare(text);
    let (mut used, mut exported, mut rest) = (Vec::new(), Vec::new(), String::new());
    for statement in code.split_inclusive(';') {
        let begin = statement.rfind("use ").filter(|at| {
            let before = statement[..*at].trim_end();
            before.is_empty() || before.ends_with(['}', ';', ']', ')']) || before.ends_with("pub")
        });
        match begin.filter(|_| statement.ends_with(';')) {
            Some(at) => {
                let before = statement[..at].trim_end();
                let is_export = before.ends_with("pub") || before.ends_with(')');
                let paths = expand(statement[at + 4..].trim_end_matches(';'));
                if is_export {
                    exported.extend(paths);
                } else {
                    used.extend(paths);
                }
                rest.push_str(before);
            }
            None => rest.push_str(statement),
        }
    }
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let paths = rest.split(|c| !is_path(c)).filter(|word| word.contains("::"));
    used.extend(paths.map(|p| p.split("::").map(String::from).collect::<Path>()));
    Named { used, exported }
}

/// All modules by path, with what they name.
struct Crate {
    modules: BTreeMap<Path, Named>,
}

impl Crate {
    fn new(sources: &[Source]) -> Self {
        let modules =
            sources.iter().map(|source| (source.module.clone(), named(&source.text))).collect();
        Crate { modules }
    }

    /// A path as it stands in a module, from the crate's root; `None` for other crates' paths.
    fn absolute(&self, module: &Path, path: &Path) -> Option<Path> {
        let mut base = module.clone();
        let mut parts = path.as_slice();
        match parts.first()?.as_str() {
            "crate" => (base, parts) = (Path::new(), &parts[1..]),
            "self" => parts = &parts[1..],
            "super" => {}
            child => {
                let is_child = self.modules.contains_key(&[&base[..], &[child.into()]].concat());
                return is_child.then(|| [&base[..], parts].concat());
            }
        }
        while parts.first().is_some_and(|part| part == "super") {
            base.pop();
            parts = &parts[1..];
        }
        Some([&base[..], parts].concat())
    }

    /// The module that defines what an absolute path leads to; re-exports are followed.
    fn definition(&self, path: &Path, depth: usize) -> Option<Path> {
        let length = (0..=path.len()).rev().find(|n| self.modules.contains_key(&path[..*n]))?;
        let (module, rest) = (path[..length].to_vec(), &path[length..]);
        let Some(item) = rest.first().filter(|_| depth < 8) else { return Some(module) };
        for exported in &self.modules[&module].exported {
            let last = exported.last()?;
            if last == item || last == "*" {
                let mut target = self.absolute(&module, exported)?;
                if last == "*" {
                    target.pop();
                    target.push(item.clone());
                }
                return self.definition(&target, depth + 1);
            }
        }
        Some(module)
    }

    /// Modules of the same top-level module that a module depends on.
    fn dependencies(&self, module: &Path) -> BTreeSet<Path> {
        let used = self.modules[module].used.iter();
        used.filter_map(|path| self.definition(&self.absolute(module, path)?, 0))
            .filter(|other| other != module && other.first() == module.first())
            .collect()
    }

    /// Modules that depend on themselves by way of others, each with one such way.
    fn cycles(&self) -> Vec<String> {
        let direct: BTreeMap<&Path, BTreeSet<Path>> =
            self.modules.keys().map(|module| (module, self.dependencies(module))).collect();
        let way_back = |start: &Path| -> Option<Vec<Path>> {
            let (mut seen, mut queue) = (BTreeSet::new(), vec![vec![start.clone()]]);
            while !queue.is_empty() {
                let way = queue.remove(0);
                for next in &direct[way.last()?] {
                    if next == start {
                        return Some(way);
                    }
                    if seen.insert(next.clone()) {
                        queue.push([&way[..], std::slice::from_ref(next)].concat());
                    }
                }
            }
            None
        };
        let text =
            |way: Vec<Path>| way.iter().map(|path| path.join("::")).collect::<Vec<_>>().join(" → ");
        self.modules.keys().filter(|m| !m.is_empty()).filter_map(way_back).map(text).collect()
    }
}

#[test]
fn files_of_a_module_do_not_depend_on_each_other_in_a_cycle() {
    let cycles = Crate::new(&sources()).cycles();
    let listed = cycles.join("\n");
    println!("{} files in cycles, {FILES_IN_CYCLES} allowed:\n{listed}", cycles.len());
    assert!(cycles.len() <= FILES_IN_CYCLES, "{} files in cycles:\n{listed}", cycles.len());
}

#[test]
fn cycles_are_found_through_re_exports_and_nested_imports() {
    let source = |module: &[&str], text: &str| Source {
        path: String::new(),
        module: module.iter().map(ToString::to_string).collect(),
        text: text.into(),
    };
    let with = |c: &str| {
        Crate::new(&[
            source(&["a"], "mod b;\nmod c;\npub use b::{B, other::D};\n"),
            source(&["a", "b"], "use super::c::{self, x::C};\npub struct B(C);\n"),
            source(&["a", "c"], c),
        ])
        .cycles()
    };
    assert_eq!(with("use super::B;\nfn f() -> B {}\n"), ["a::b → a::c", "a::c → a::b"]);
    assert_eq!(with("fn f() -> super::B {}\n"), ["a::b → a::c", "a::c → a::b"]);
    assert_eq!(with("// use super::B;\nuse crate::z::B;\n"), Vec::<String>::new());
}
