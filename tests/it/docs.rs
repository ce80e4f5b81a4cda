//! The docs hold what they promise: every command in them runs, every link leads somewhere, and
//! docs/commands.md is the help of the program (`UNWATER_BLESS=1 cargo test --test it docs`
//! rewrites it).
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use clap::CommandFactory;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Commands of the docs that are not run, and why. Each is the beginning of a line.
const NOT_RUN: [(&str, &str); 8] = [
    ("git clone", "needs the network"),
    ("cargo ", "builds or tests all anew; CI does that by itself"),
    ("pip install", "needs the network; CI installs the same versions for the playback tests"),
    (
        "python ",
        "opens a window, or measures for an hour; the playback tests load the layout's script",
    ),
    ("rerun ", "opens a window"),
    ("man ", "opens a pager"),
    (".ci/run", "is what runs this"),
    ("tests/playback/", "CI runs them, or they need a screen"),
];

/// Pages of people's docs, from the root.
fn pages() -> Vec<PathBuf> {
    let mut pages: Vec<PathBuf> = [
        "README.md",
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "sample_logs/README.md",
        "fuzz/README.md",
    ]
    .map(PathBuf::from)
    .into();
    let docs = std::fs::read_dir(Path::new(ROOT).join("docs")).unwrap().flatten().map(|e| e.path());
    pages.extend(
        docs.filter(|p| p.extension().is_some_and(|e| e == "md"))
            .map(|p| p.strip_prefix(ROOT).unwrap().to_path_buf()),
    );
    pages.sort();
    pages
}

fn text_of(page: &Path) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(page))
        .unwrap_or_else(|e| panic!("{}: {e}", page.display()))
}

/// The page without its code blocks, and the code blocks with their language.
fn parts(text: &str) -> (String, Vec<(String, String)>) {
    let (mut prose, mut blocks, mut open) = (String::new(), Vec::<(String, String)>::new(), false);
    for line in text.lines() {
        match (line.trim_start().strip_prefix("```"), open) {
            (Some(language), false) => {
                open = true;
                blocks.push((language.trim().into(), String::new()));
            }
            (Some(_), true) => open = false,
            (None, true) => writeln!(blocks.last_mut().unwrap().1, "{line}").unwrap(),
            (None, false) => writeln!(prose, "{line}").unwrap(),
        }
    }
    assert!(!open, "a code block without its end");
    (prose, blocks)
}

/// What a forge, and mdBook, make of a heading.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// Targets of a page's links.
fn links(prose: &str) -> Vec<String> {
    prose.split("](").skip(1).filter_map(|rest| rest.split(')').next()).map(String::from).collect()
}

/// `docs/../README.md` → `README.md`
fn plain(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                assert!(out.pop(), "{} leads out of the repository", path.display());
            }
            other => out.push(other),
        }
    }
    out
}

#[test]
fn every_link_resolves() {
    let mut wrong = Vec::new();
    for page in pages() {
        let (prose, _) = parts(&text_of(&page));
        for link in links(&prose) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (file, fragment) = link.split_once('#').unwrap_or((&link, ""));
            let target = if file.is_empty() {
                page.clone()
            } else {
                plain(&page.parent().unwrap().join(file))
            };
            if !Path::new(ROOT).join(&target).exists() {
                wrong.push(format!("{}: {link}", page.display()));
            } else if !fragment.is_empty() && target.extension().is_some_and(|e| e == "md") {
                let (prose, _) = parts(&text_of(&target));
                let is_there = prose.lines().any(|l| {
                    l.starts_with('#') && anchor(l.trim_start_matches('#').trim()) == fragment
                });
                if !is_there {
                    wrong.push(format!("{}: {link}: no such heading", page.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "links that lead nowhere:\n{}", wrong.join("\n"));
}

#[test]
fn every_page_is_in_the_book() {
    let summary = text_of(Path::new("docs/SUMMARY.md"));
    let listed: BTreeSet<PathBuf> =
        links(&summary).iter().map(|l| plain(&Path::new("docs").join(l))).collect();
    let written: BTreeSet<PathBuf> =
        pages().into_iter().filter(|p| !p.ends_with("SUMMARY.md")).collect();
    let missing: Vec<_> = written.difference(&listed).collect();
    assert!(missing.is_empty(), "docs/SUMMARY.md does not list {missing:?}");
}

/// `docs/commands.md`: every command in the program's own words.
fn commands_page() -> String {
    let mut program = unwater::cli::Cli::command().term_width(100).disable_help_subcommand(true);
    program.build();
    let mut page = String::from(
        "# Commands\n\nMade from the program's own words (`unwater COMMAND --help`); a test holds \
         it to them and runs the examples. Exit status and files: [formats.md](formats.md).\n",
    );
    for command in program.get_subcommands_mut() {
        let name = command.get_bin_name().unwrap_or_default().to_string();
        let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        let examples: String = after
            .lines()
            .filter_map(|l| l.strip_prefix("  unwater "))
            .map(|l| format!("unwater {l}\n"))
            .collect();
        let help = command.clone().after_help("").render_long_help().to_string();
        let help: Vec<&str> = help.lines().map(str::trim_end).collect();
        let rest: Vec<&str> =
            after.lines().filter(|l| !l.starts_with("  ") && !l.starts_with("Example")).collect();
        write!(page, "\n## {name}\n\n```text\n{}\n```\n", help.join("\n").trim()).unwrap();
        if !examples.is_empty() {
            write!(page, "\n```sh\n{examples}```\n").unwrap();
        }
        let rest = rest.join("\n");
        if !rest.trim().is_empty() {
            write!(page, "\n{}\n", rest.trim()).unwrap();
        }
    }
    page
}

#[test]
fn commands_page_matches_the_help() {
    let path = Path::new(ROOT).join("docs/commands.md");
    let is = commands_page();
    if std::env::var_os("UNWATER_BLESS").is_some() {
        std::fs::write(&path, &is).unwrap();
    }
    let was = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        was == is,
        "docs/commands.md is not what the program says: UNWATER_BLESS=1 cargo test --test it docs"
    );
}

/// Runs the commands of a page; how many there were.
#[cfg(unix)]
fn type_out(page: PathBuf, [dive_log, second]: [&Path; 2], path: &str) -> usize {
    let (_, blocks) = parts(&text_of(&page));
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(
        Path::new(ROOT).join("sample_logs"),
        folder.path().join("sample_logs"),
    )
    .unwrap();
    for (name, log) in [
        ("dive.mcap", dive_log),
        ("dive_1.mcap", dive_log),
        ("dive_2.mcap", second),
        ("dive_3.mcap", dive_log),
    ] {
        std::fs::copy(log, folder.path().join(name)).unwrap();
    }
    let mut ran = 0;
    for line in
        blocks.iter().filter(|(language, _)| language == "sh").flat_map(|(_, block)| block.lines())
    {
        let line = line.trim();
        // The first build is what `cargo run` adds to the program's own words.
        let line = line
            .strip_prefix("cargo run --release -- ")
            .map_or_else(|| line.to_string(), |words| format!("unwater {words}"));
        if line.is_empty()
            || line.starts_with('#')
            || NOT_RUN.iter().any(|(begin, _)| line.starts_with(begin))
        {
            continue;
        }
        let shell = ["-c", line.as_str()];
        let done = std::process::Command::new("sh")
            .args(shell)
            .current_dir(folder.path())
            .env("PATH", path)
            .env("HOME", folder.path())
            .output()
            .unwrap();
        assert!(
            done.status.success(),
            "{}: `{line}`: {}",
            page.display(),
            String::from_utf8_lossy(&done.stderr)
        );
        ran += 1;
    }
    ran
}

/// Every line of every `sh` block, block by block in one folder for each page, as a reader would
/// type them. `sample_logs` is the repository's; `dive.mcap` and its like are a small rendered
/// dive.
#[cfg(unix)]
#[test]
fn every_command_runs() {
    let program = Path::new(env!("CARGO_BIN_EXE_unwater")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap_or_default());
    let dive = tempfile::tempdir().unwrap();
    let logs = [1, 2].map(|seed| {
        let log = dive.path().join(format!("{seed}.mcap"));
        crate::support::render::Dive {
            seed,
            frames: 14,
            width: 216,
            height: 162,
            focal_px: 255.0,
            ..Default::default()
        }
        .write(&log);
        log
    });
    let logs = [logs[0].as_path(), logs[1].as_path()];
    // Page by page beside each other: each waits for its own commands only.
    let ran: usize = std::thread::scope(|scope| {
        let pages: Vec<_> =
            pages().into_iter().map(|page| scope.spawn(|| type_out(page, logs, &path))).collect();
        pages
            .into_iter()
            .map(|page| page.join().unwrap_or_else(|e| std::panic::resume_unwind(e)))
            .sum()
    });
    assert!(ran >= 20, "{ran} commands");
    for (begin, why) in NOT_RUN {
        assert!(!why.is_empty() && !begin.starts_with("unwater"), "a command of ours is to be run");
    }
}
