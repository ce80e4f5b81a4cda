//! The source files: text, module path, code without comments.
use std::path::{Path, PathBuf};

/// One file of `src`.
pub struct Source {
    /// from the repository's root, with `/`
    pub path: String,
    /// without `crate`: `["estimate", "joint"]` for `src/estimate/joint/mod.rs`
    pub module: Vec<String>,
    pub text: String,
}

impl Source {
    /// Lines of code outside of comments, each with its number from 1.
    pub fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let is_code = |line: &str| !line.trim_start().starts_with("//");
        (1..).zip(self.text.lines()).filter(move |(_, line)| is_code(line))
    }
}

/// All files below a folder with one extension, sorted.
pub fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// All files of `src`.
pub fn sources() -> Vec<Source> {
    files(Path::new("src"), "rs")
        .into_iter()
        .map(|file| {
            let text = std::fs::read_to_string(&file).expect("a source");
            let path = file.to_string_lossy().replace('\\', "/");
            let inside = path.trim_start_matches("src/").trim_end_matches(".rs");
            let module = inside
                .split('/')
                .filter(|part| !matches!(*part, "mod" | "lib" | "main"))
                .map(String::from)
                .collect();
            Source { path, module, text }
        })
        .collect()
}
