//! The house keeps its order: imports point down only, and ARCHITECTURE.md says what is so.
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Rooms and floors from the table of ARCHITECTURE.md.
fn floors() -> BTreeMap<String, u32> {
    let page = std::fs::read_to_string("ARCHITECTURE.md").expect("the page");
    page.lines()
        .filter_map(|line| {
            let mut cells = line.trim().strip_prefix('|')?.split('|').map(str::trim);
            let floor = cells.next()?.parse().ok()?;
            let room = cells.next()?.trim_matches('`');
            Some((room.to_string(), floor))
        })
        .collect()
}

#[test]
fn imports_point_down_only() {
    let floors = floors();
    let mut files = Vec::new();
    sources(Path::new("src"), &mut files);
    let rooms: Vec<String> = std::fs::read_to_string("src/lib.rs")
        .expect("lib.rs")
        .lines()
        .filter_map(|l| l.strip_prefix("pub mod ")?.strip_suffix(';').map(String::from))
        .collect();
    for room in &rooms {
        assert!(floors.contains_key(room), "ARCHITECTURE.md has no floor for {room}");
    }
    assert_eq!(rooms.len(), floors.len(), "ARCHITECTURE.md has rooms that are not there");
    let mut wrong = Vec::new();
    for file in &files {
        let inside = file.strip_prefix("src").expect("in src");
        let room = inside
            .components()
            .next()
            .expect("a room")
            .as_os_str()
            .to_string_lossy()
            .trim_end_matches(".rs")
            .to_string();
        let Some(own) = floors.get(&room) else { continue };
        let text = std::fs::read_to_string(file).expect("a source");
        for (number, line) in
            text.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with("//"))
        {
            for used in line.split("crate::").skip(1) {
                let used: String =
                    used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                if let Some(floor) = floors.get(&used).filter(|floor| used != room && *floor >= own)
                {
                    wrong.push(format!(
                        "{}:{}: {room} (floor {own}) uses {used} (floor {floor})",
                        file.display(),
                        number + 1
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "imports that do not point down:\n{}", wrong.join("\n"));
}

fn files_naming(word: &str) -> Vec<String> {
    let mut files = Vec::new();
    sources(Path::new("src"), &mut files);
    let names = |path: &PathBuf| {
        std::fs::read_to_string(path)
            .expect("a source")
            .lines()
            .any(|l| !l.trim_start().starts_with("//") && l.contains(word))
    };
    let mut found: Vec<String> = files
        .iter()
        .filter(|f| names(f))
        .map(|f| f.display().to_string().replace('\\', "/"))
        .collect();
    found.sort();
    found
}

#[test]
fn threads_live_in_one_file_and_the_container_in_one_room() {
    assert_eq!(files_naming("rayon::"), ["src/parallel.rs"]);
    let of_container = files_naming("mcap::");
    assert!(of_container.iter().all(|file| file.starts_with("src/recording/")), "{of_container:?}");
    assert_eq!(
        files_naming("HashMap"),
        Vec::<String>::new(),
        "nothing that reaches the output may depend on a hash order"
    );
}
