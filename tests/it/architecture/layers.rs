//! ARCHITECTURE.md and the imports between top-level modules.
use std::collections::BTreeMap;

use super::source::sources;

/// Top-level modules and their layers, from the table of ARCHITECTURE.md.
fn layers() -> BTreeMap<String, u32> {
    let page = std::fs::read_to_string("ARCHITECTURE.md").expect("the page");
    page.lines()
        .filter_map(|line| {
            let mut cells = line.trim().strip_prefix('|')?.split('|').map(str::trim);
            let layer = cells.next()?.parse().ok()?;
            let module = cells.next()?.trim_matches('`');
            Some((module.to_string(), layer))
        })
        .collect()
}

#[test]
fn every_module_has_a_layer() {
    let layers = layers();
    let modules: Vec<String> = std::fs::read_to_string("src/lib.rs")
        .expect("lib.rs")
        .lines()
        .filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod ")?.strip_suffix(';'))
        .map(String::from)
        .collect();
    for module in &modules {
        assert!(layers.contains_key(module), "ARCHITECTURE.md has no layer for {module}");
    }
    assert_eq!(modules.len(), layers.len(), "ARCHITECTURE.md has modules that do not exist");
}

#[test]
fn imports_point_down() {
    let layers = layers();
    let mut wrong = Vec::new();
    for source in sources() {
        let Some(module) = source.module.first() else { continue };
        let Some(own) = layers.get(module) else { continue };
        for (number, line) in source.code() {
            for used in line.split("crate::").skip(1) {
                let is_name = |c: &char| c.is_alphanumeric() || *c == '_';
                let used: String = used.chars().take_while(is_name).collect();
                let Some(layer) = layers.get(&used) else { continue };
                if used != *module && layer >= own {
                    wrong.push(format!(
                        "{}:{number}: {module} (layer {own}) uses {used} (layer {layer})",
                        source.path
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "imports that do not point down:\n{}", wrong.join("\n"));
}

/// Files of `src` whose code contains a text.
fn files_with(text: &str) -> Vec<String> {
    let has = |source: &&super::source::Source| source.code().any(|(_, line)| line.contains(text));
    sources().iter().filter(has).map(|source| source.path.clone()).collect()
}

#[test]
fn threads_are_in_one_file_and_the_container_in_one_module() {
    assert_eq!(files_with("rayon::"), ["src/parallel.rs"]);
    let of_container = files_with("mcap::");
    assert!(!of_container.is_empty());
    assert!(of_container.iter().all(|file| file.starts_with("src/recording/")), "{of_container:?}");
}

/// Nothing that reaches the output may depend on the order of a hash.
#[test]
fn there_are_no_hash_maps() {
    assert_eq!(files_with("HashMap"), Vec::<String>::new());
    assert_eq!(files_with("HashSet"), Vec::<String>::new());
}
