//! Lengths of lines, files and functions, and numbers of arguments.
use std::path::Path;

use super::source::{Source, files, sources};

const COLUMNS: usize = 100;
const LINES_OF_FILE: usize = 450;
const LINES_OF_FUNCTION: usize = 60;
const ARGUMENTS: usize = 5;

/// How many exceptions there still are. These numbers may only become smaller.
const LONG_FILES: usize = 0;
const LONG_FUNCTIONS: usize = 1;
const LONG_SIGNATURES: usize = 6;
const WIDE_LINES: usize = 0;

/// A function with the number of its lines of code and of its arguments, as clippy counts them.
struct Function {
    name: String,
    lines: usize,
    arguments: usize,
}

/// Functions of a file that rustfmt has formatted: one ends at the first `}` of its indentation.
fn functions(source: &Source) -> Vec<Function> {
    let code: Vec<&str> =
        source.code().map(|(_, line)| line).filter(|line| !line.trim().is_empty()).collect();
    let mut found = Vec::new();
    for (at, line) in code.iter().enumerate() {
        let words = line.trim_start();
        let indentation = &line[..line.len() - words.len()];
        let before = words.split("fn ").next().unwrap_or_default();
        let is_modifier = |word: &str| word.starts_with("pub") || word == "const";
        if !words.contains("fn ") || !before.split_whitespace().all(is_modifier) {
            continue;
        }
        let end = format!("{indentation}}}");
        let is_end = |line: &&str| line.ends_with('}') && line.trim_end_matches("}") == indentation;
        let lines = if line.ends_with('}') || line.ends_with(';') {
            1
        } else {
            1 + code[at..].iter().position(|line| *line == end || is_end(line)).unwrap_or(0)
        };
        let signature = code[at..code.len().min(at + 20)].join(" ");
        let name = signature.split("fn ").nth(1).unwrap_or_default();
        let name = name.split(['(', '<']).next().unwrap_or_default().to_string();
        let arguments = arguments(&signature);
        found.push(Function { name, lines, arguments });
    }
    found
}

/// Arguments of the first function in a text.
fn arguments(text: &str) -> usize {
    let start = text.find("fn ").map_or(0, |at| at + 3);
    // `fn name<F: Fn(&T) -> U>(…)`: the list opens at the first parenthesis outside of `<>`.
    let (mut depth, mut angles, mut parts) = (0, 0, vec![String::new()]);
    for (before, c) in
        text[start..].chars().scan(' ', |last, c| Some((std::mem::replace(last, c), c)))
    {
        match c {
            '<' => angles += 1,
            '>' if before != '-' => angles -= 1,
            '(' | '[' if depth > 0 || angles == 0 => depth += 1,
            ')' | ']' if depth > 0 => depth -= 1,
            _ => {}
        }
        if depth == 1 && c == ',' && angles == 0 {
            parts.push(String::new());
        } else if depth > 0 {
            parts.last_mut().expect("a part").push(c);
        } else if c == ')' && angles == 0 {
            break;
        }
    }
    parts.iter().filter(|part| !part.trim_matches(['(', ' ']).is_empty()).count()
}

fn assert_few(what: &str, found: &[String], known: usize) {
    assert!(
        found.len() <= known,
        "{} {what} instead of {known}:\n{}",
        found.len(),
        found.join("\n")
    );
    println!("{} {what}, {known} allowed:\n{}", found.len(), found.join("\n"));
}

#[test]
fn files_of_src_are_short() {
    let long: Vec<String> = sources()
        .iter()
        .map(|source| (source, source.text.lines().count()))
        .filter(|(_, lines)| *lines > LINES_OF_FILE)
        .map(|(source, lines)| format!("{}: {lines} lines", source.path))
        .collect();
    assert_few("files are too long", &long, LONG_FILES);
}

#[test]
fn functions_are_short_and_take_few_arguments() {
    let (mut long, mut wide) = (Vec::new(), Vec::new());
    for source in sources() {
        for Function { name, lines, arguments } in functions(&source) {
            if lines > LINES_OF_FUNCTION {
                long.push(format!("{}: {name}: {lines} lines", source.path));
            }
            if arguments > ARGUMENTS {
                wide.push(format!("{}: {name}: {arguments} arguments", source.path));
            }
        }
    }
    assert_few("functions are too long", &long, LONG_FUNCTIONS);
    assert_few("functions take too many arguments", &wide, LONG_SIGNATURES);
}

#[test]
fn functions_are_counted_as_they_are() {
    let text = concat!(
        "impl A {\n    pub fn a<F: Fn(&B, C) -> D>(&mut self, f: F, (g, h): (I, J)) -> [K; 2] {\n",
        "        // a comment\n\n        l\n    }\n}\nfn b(\n    m: N,\n) {\n}\n"
    );
    let source = Source { path: String::new(), module: Vec::new(), text: text.into() };
    let counted: Vec<_> =
        functions(&source).into_iter().map(|f| (f.name, f.lines, f.arguments)).collect();
    assert_eq!(counted, [("a".to_string(), 3, 3), ("b".to_string(), 4, 1)]);
}

#[test]
fn lines_are_at_most_100_columns_wide() {
    let wide: Vec<String> = ["src", "tests", "examples", "benches", "fuzz/fuzz_targets"]
        .iter()
        .flat_map(|folder| files(Path::new(folder), "rs"))
        .flat_map(|file| {
            let text = std::fs::read_to_string(&file).expect("a source");
            let wide = |(number, line): (usize, &str)| {
                (line.chars().count() > COLUMNS).then(|| format!("{}:{number}", file.display()))
            };
            (1..).zip(text.lines()).filter_map(wide).collect::<Vec<_>>()
        })
        .collect();
    assert_few("lines are too wide", &wide, WIDE_LINES);
}
