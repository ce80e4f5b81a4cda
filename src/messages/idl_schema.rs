//! Parses `ros2idl` and `omgidl` schemas.
//!
//! The subset that ROS 2 generates and DDS users write: modules, structs, enums, typedefs,
//! constants as sizes, sequences, bounded strings, arrays. Annotations and preprocessor lines are
//! ignored; the use of a union is an error.

use std::collections::BTreeMap;

use super::layout::{
    Definitions, Layout, MAX_NESTING, Primitive, UnresolvedField, UnresolvedType, build,
};

/// Parses the text; `name` is `pkg/msg/Type` or `pkg::msg::Type`.
///
/// # Errors
/// The text is not valid in this subset, or a type is unknown or recursive.
pub fn parse(name: &str, text: &str) -> Result<Layout, String> {
    let mut parser = Parser { tokens: tokens(text), at: 0, scope: Vec::new(), ..Parser::default() };
    parser.definitions()?;
    let Parser { mut structs, .. } = parser;
    let time = || [("sec", Primitive::Int(4)), ("nanosec", Primitive::UInt(4))];
    for known in ["builtin_interfaces::msg::Time", "builtin_interfaces::msg::Duration"] {
        let fields = time().map(|(name, p)| UnresolvedField {
            name: name.into(),
            kind: UnresolvedType::Primitive(p),
        });
        structs.entry(known.into()).or_insert_with(|| fields.to_vec());
    }
    let root = name.replace('/', "::");
    let root = if structs.contains_key(&root) {
        root
    } else {
        structs.keys().find(|k| last(k) == last(&root)).cloned().unwrap_or(root)
    };
    Ok(build(&structs, &root, &|base, scope| in_scope(base, scope, &structs))?.0)
}

fn last(name: &str) -> &str {
    name.rsplit("::").next().unwrap_or(name)
}

/// Nesting depth of arrays.
fn array_depth(mut kind: &UnresolvedType) -> usize {
    let mut depth = 0;
    while let UnresolvedType::Array(inner, _) = kind {
        (kind, depth) = (inner, depth + 1);
    }
    depth
}

/// Full name of a definition: of the innermost scope that has it.
fn in_scope<T>(base: &str, scope: &str, known: &BTreeMap<String, T>) -> Option<String> {
    let base = base.trim_start_matches("::");
    let mut scope = scope;
    loop {
        let candidate =
            if scope.is_empty() { base.to_string() } else { format!("{scope}::{base}") };
        if known.contains_key(&candidate) {
            return Some(candidate);
        }
        if scope.is_empty() {
            return None;
        }
        scope = scope.rfind("::").map_or("", |end| &scope[..end]);
    }
}

/// Identifiers and punctuation, without comments, preprocessor lines and separators of files.
fn tokens(text: &str) -> Vec<String> {
    let mut tokens = Vec::new();
    let mut in_comment = false;
    for line in text.lines() {
        let trimmed = line.trim_start();
        if !in_comment
            && (trimmed.starts_with('#')
                || trimmed.starts_with("IDL:")
                || trimmed.starts_with("==="))
        {
            continue;
        }
        let mut rest = line;
        while let Some(c) = rest.chars().next() {
            if in_comment {
                let Some(end) = rest.find("*/") else { break };
                in_comment = false;
                rest = &rest[end + 2..];
            } else if rest.starts_with("//") {
                break;
            } else if rest.starts_with("/*") {
                in_comment = true;
                rest = &rest[2..];
            } else if c == '"' || c == '\'' {
                // Strings occur only in annotations and constants, which are ignored.
                let inside = &rest[1..];
                rest = inside.find(c).map_or("", |end| &inside[end + 1..]);
                tokens.push("\"\"".into());
            } else if c.is_alphanumeric() || c == '_' || rest.starts_with("::") {
                let mut end = 0;
                while let Some(n) = rest[end..].chars().next() {
                    if n.is_alphanumeric() || n == '_' {
                        end += n.len_utf8();
                    } else if rest[end..].starts_with("::") {
                        end += 2;
                    } else {
                        break;
                    }
                }
                tokens.push(rest[..end].into());
                rest = &rest[end..];
            } else {
                if !c.is_whitespace() {
                    tokens.push(c.into());
                }
                rest = &rest[c.len_utf8()..];
            }
        }
    }
    tokens
}

#[derive(Default)]
struct Parser {
    tokens: Vec<String>,
    at: usize,
    scope: Vec<String>,
    structs: Definitions,
    /// typedefs and enums, by full name
    aliases: BTreeMap<String, UnresolvedType>,
    constants: BTreeMap<String, usize>,
}

impl Parser {
    fn peek(&self) -> &str {
        self.tokens.get(self.at).map_or("", String::as_str)
    }

    fn next(&mut self) -> Result<String, String> {
        let word = self.tokens.get(self.at).cloned().ok_or("the IDL schema ends early")?;
        self.at += 1;
        Ok(word)
    }

    fn accept(&mut self, word: &str) -> bool {
        let found = self.peek() == word;
        self.at += usize::from(found);
        found
    }

    fn expect(&mut self, word: &str) -> Result<(), String> {
        let found = self.next()?;
        if found == word {
            Ok(())
        } else {
            Err(format!("the IDL schema has {found:?} instead of {word:?}"))
        }
    }

    fn full(&self, name: &str) -> String {
        self.scope.iter().map(String::as_str).chain([name]).collect::<Vec<_>>().join("::")
    }

    fn definitions(&mut self) -> Result<(), String> {
        while self.at < self.tokens.len() {
            let word = self.next()?;
            match word.as_str() {
                "module" => {
                    let name = self.next()?;
                    self.scope.push(name);
                    self.expect("{")?;
                }
                "}" => {
                    self.scope.pop();
                }
                "@" => self.annotation()?,
                "struct" => self.structure()?,
                "typedef" => {
                    let kind = self.kind()?;
                    for (name, kind) in self.declarators(&kind)? {
                        let full = self.full(&name);
                        self.aliases.insert(full, kind);
                    }
                }
                "enum" => {
                    let name = self.next()?;
                    let full = self.full(&name);
                    self.aliases.insert(full, UnresolvedType::Primitive(Primitive::UInt(4)));
                    self.skip_until("}")?;
                }
                "const" => {
                    let _kind = self.kind()?;
                    let name = self.next()?;
                    self.expect("=")?;
                    if let Ok(value) = self.peek().parse() {
                        let full = self.full(&name);
                        self.constants.insert(full, value);
                    }
                    self.skip_until(";")?;
                }
                "union" | "interface" | "bitmask" | "bitset" => self.skip_until("}")?,
                ";" => {}
                other => {
                    return Err(format!("the IDL schema has {other:?} instead of a definition"));
                }
            }
        }
        Ok(())
    }

    fn skip_until(&mut self, end: &str) -> Result<(), String> {
        let mut depth = 0usize;
        loop {
            let word = self.next()?;
            depth += usize::from(word == "{");
            if word == "}" {
                depth = depth.saturating_sub(1);
            }
            if word == end && depth == 0 {
                return Ok(());
            }
        }
    }

    fn annotation(&mut self) -> Result<(), String> {
        self.next()?;
        if self.accept("(") {
            let mut depth = 1usize;
            while depth > 0 {
                match self.next()?.as_str() {
                    "(" => depth += 1,
                    ")" => depth -= 1,
                    _ => {}
                }
            }
        }
        Ok(())
    }

    fn structure(&mut self) -> Result<(), String> {
        let name = self.next()?;
        if self.accept(";") {
            return Ok(());
        }
        if self.accept(":") {
            return Err(format!("the IDL struct {name} inherits, which is not supported"));
        }
        self.expect("{")?;
        let mut fields = Vec::new();
        while !self.accept("}") {
            if self.accept("@") {
                self.annotation()?;
                continue;
            }
            let kind = self.kind()?;
            fields.extend(
                self.declarators(&kind)?
                    .into_iter()
                    .map(|(name, kind)| UnresolvedField { name, kind }),
            );
        }
        let full = self.full(&name);
        self.structs.insert(full, fields);
        Ok(())
    }

    /// `a, b[3];`
    fn declarators(
        &mut self,
        kind: &UnresolvedType,
    ) -> Result<Vec<(String, UnresolvedType)>, String> {
        let mut found = Vec::new();
        loop {
            let name = self.next()?;
            let mut sizes = Vec::new();
            while self.accept("[") {
                sizes.push(self.size()?);
                self.expect("]")?;
            }
            // Typedefs of typedefs add up: limit the depth here.
            if array_depth(kind) + sizes.len() > MAX_NESTING {
                return Err(format!("the IDL schema nests more than {MAX_NESTING} arrays"));
            }
            let kind = sizes.into_iter().rev().fold(kind.clone(), |inner, size| {
                UnresolvedType::Array(Box::new(inner), Some(size))
            });
            found.push((name, kind));
            if !self.accept(",") {
                self.expect(";")?;
                return Ok(found);
            }
        }
    }

    fn size(&mut self) -> Result<usize, String> {
        let word = self.next()?;
        let constant = || {
            in_scope(&word, &self.scope.join("::"), &self.constants)
                .and_then(|n| self.constants.get(&n).copied())
        };
        word.parse()
            .ok()
            .or_else(constant)
            .ok_or_else(|| format!("the IDL schema has an invalid size {word:?}"))
    }

    fn bound(&mut self) -> Result<(), String> {
        if self.accept("<") {
            self.size()?;
            self.expect(">")?;
        }
        Ok(())
    }

    fn kind(&mut self) -> Result<UnresolvedType, String> {
        let mut sequences = 0;
        while self.accept("sequence") {
            self.expect("<")?;
            sequences += 1;
            if sequences > MAX_NESTING {
                return Err(format!("the IDL schema nests more than {MAX_NESTING} sequences"));
            }
        }
        let word = self.next()?;
        let primitive = match word.as_str() {
            "boolean" => Some(Primitive::Bool),
            "octet" | "char" | "uint8" => Some(Primitive::UInt(1)),
            "int8" => Some(Primitive::Int(1)),
            "short" | "int16" => Some(Primitive::Int(2)),
            "uint16" => Some(Primitive::UInt(2)),
            "int32" => Some(Primitive::Int(4)),
            "uint32" => Some(Primitive::UInt(4)),
            "int64" => Some(Primitive::Int(8)),
            "uint64" => Some(Primitive::UInt(8)),
            "float" => Some(Primitive::Float(4)),
            "double" => Some(Primitive::Float(8)),
            "long" if self.accept("double") => {
                return Err("the IDL schema has a long double, which is not supported".into());
            }
            "long" => Some(Primitive::Int(if self.accept("long") { 8 } else { 4 })),
            "unsigned" => Some(match self.next()?.as_str() {
                "short" => Primitive::UInt(2),
                _ => Primitive::UInt(if self.accept("long") { 8 } else { 4 }),
            }),
            "string" | "wstring" => {
                self.bound()?;
                Some(if word == "string" { Primitive::Text } else { Primitive::WideText })
            }
            _ => None,
        };
        let scope = self.scope.join("::");
        let mut kind = match primitive {
            Some(p) => UnresolvedType::Primitive(p),
            None => in_scope(&word, &scope, &self.aliases)
                .and_then(|full| self.aliases.get(&full).cloned())
                .unwrap_or(UnresolvedType::Named(word)),
        };
        for _ in 0..sequences {
            if self.accept(",") {
                self.size()?;
            }
            self.expect(">")?;
            kind = UnresolvedType::Array(Box::new(kind), None);
        }
        Ok(kind)
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::Type;
    use super::*;

    #[test]
    fn schemas_generated_by_ros_are_parsed() {
        let text = "================\nIDL: p/msg/Dvl\n// made\n#include \
                    \"p/msg/Beam.idl\"\nmodule p { module msg {\n  typedef double double__3[3];\n  \
                    module Dvl_Constants { const uint8 MODE = 1; };\n  /* a\n  dvl */ @verbatim \
                    (language=\"comment\", text=\"a (b)\" \"c\")\n  struct Dvl {\n    \
                    @unit(value=\"m\") sequence<p::msg::Beam, 8> beams;\n    double__3 v, w;\n    \
                    unsigned long long time;\n    string<12> form;\n    octet raw[4];\n  };\n}; \
                    };\n================\nIDL: p/msg/Beam\nmodule p { module msg { struct Beam { \
                    double distance; boolean valid; }; }; };\n";
        let layout = parse("p/msg/Dvl", text).expect("a layout");
        assert!(layout.has_all(&["beams.distance", "beams.valid", "time", "form"]));
        let three = Type::Array(Box::new(Type::Primitive(Primitive::Float(8))), Some(3));
        assert_eq!((layout.type_at("v"), layout.type_at("w")), (Some(&three), Some(&three)));
        assert_eq!(
            layout.type_at("raw"),
            Some(&Type::Array(Box::new(Type::Primitive(Primitive::UInt(1))), Some(4)))
        );
    }

    #[test]
    fn invalid_text_is_rejected() {
        for text in [
            "struct A { A a; };",
            "struct A { sequence<",
            "module",
            "struct A { B b; };",
            "struct A : B { };",
        ] {
            assert!(parse("A", text).is_err(), "{text}");
        }
    }
}
