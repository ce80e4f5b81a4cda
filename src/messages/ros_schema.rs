//! Parses `ros2msg` and `ros1msg` schemas.
//!
//! The channel's own schema determines the layout, never the name of its type: one name
//! (`ds_sensor_msgs/Dvl`) has two incompatible definitions in the field, and one shape has eight
//! names.

use super::layout::{Definitions, Layout, Primitive, UnresolvedField, UnresolvedType, build};

/// The two languages differ in the meaning of `time`, `byte` and an undefined `Header`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// `ros1msg`
    Ros1,
    /// `ros2msg`
    Ros2,
}

/// Parses a definition, followed by its dependencies after `===` lines and `MSG: pkg/Type`.
///
/// # Errors
/// A type is unknown or recursive, or a line is not a field.
pub fn parse(name: &str, text: &str, dialect: Dialect) -> Result<Layout, String> {
    let mut definitions = Definitions::new();
    let root = short(name);
    let mut current = Some(root.clone());
    for line in text.lines() {
        let line = line.trim();
        // `---` separates the request of a service from its response, which no topic carries.
        if line.len() >= 3 && (line == "---" || line.bytes().all(|b| b == b'=')) {
            current = None;
        } else if let Some(dependency) = line.strip_prefix("MSG:") {
            current = Some(short(dependency.trim()));
            definitions.entry(short(dependency.trim())).or_default();
        } else if let Some(section) = &current
            && let Some(field) = field(line, dialect)?
        {
            definitions.entry(section.clone()).or_default().push(field);
        }
    }
    definitions.entry(root.clone()).or_default();
    let stamp = ["int32 sec", "uint32 nanosec"];
    let header: &[&str] = match dialect {
        Dialect::Ros1 => &["uint32 seq", "time stamp", "string frame_id"],
        Dialect::Ros2 => &["builtin_interfaces/Time stamp", "string frame_id"],
    };
    for (known, lines) in [
        ("builtin_interfaces/Time", &stamp[..]),
        ("builtin_interfaces/Duration", &stamp),
        ("std_msgs/Header", header),
        // Primitives of ROS 1; no message can have these names.
        ("time", &["uint32 sec", "uint32 nanosec"]),
        ("duration", &stamp),
    ] {
        if !definitions.contains_key(known) {
            let fields = lines
                .iter()
                .filter_map(|l| field(l, dialect).transpose())
                .collect::<Result<_, _>>()?;
            definitions.insert(known.into(), fields);
        }
    }
    Ok(build(&definitions, &root, &|base, scope| resolve(&definitions, base, scope))?.0)
}

/// Full name of a type: `Header` and types of the same package may be written without a package.
fn resolve(definitions: &Definitions, base: &str, scope: &str) -> Option<String> {
    let base = short(base);
    let package = scope.split('/').next().unwrap_or("");
    let candidates = [
        base.clone(),
        format!("{package}/{base}"),
        format!("std_msgs/{base}"),
        format!("builtin_interfaces/{base}"),
    ];
    candidates
        .into_iter()
        .find(|c| definitions.contains_key(c))
        .or_else(|| definitions.keys().find(|k| k.rsplit('/').next() == Some(&base)).cloned())
}

/// `pkg/msg/Type` and `pkg/srv/Type` → `pkg/Type`.
fn short(name: &str) -> String {
    let parts: Vec<&str> = name.split('/').filter(|p| !p.is_empty()).collect();
    match parts.as_slice() {
        [package, _, rest] => format!("{package}/{rest}"),
        _ => parts.join("/"),
    }
}

/// The field of a line; `None` for blank lines, comments and constants.
fn field(line: &str, dialect: Dialect) -> Result<Option<UnresolvedField>, String> {
    let line = line.split('#').next().unwrap_or("").trim();
    let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
        return if line.is_empty() {
            Ok(None)
        } else {
            Err(format!("the schema line {line:?} is not a field"))
        };
    };
    let rest = rest.trim();
    let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    if name.is_empty() {
        return Err(format!("the schema line {line:?} is not a field"));
    }
    if rest[name.len()..].trim_start().starts_with('=') {
        return Ok(None);
    }
    let (base, array) = match kind.split_once('[') {
        None => (kind, None),
        Some((base, size)) => {
            let size = size.trim_end_matches(']');
            let fixed = if size.is_empty() || size.starts_with("<=") {
                None
            } else {
                Some(
                    size.parse()
                        .map_err(|e| format!("the array size in {line:?} is not a number ({e})"))?,
                )
            };
            (base, Some(fixed))
        }
    };
    let base = base.split("<=").next().unwrap_or(base);
    let element = primitive(base, dialect)
        .map_or_else(|| UnresolvedType::Named(base.into()), UnresolvedType::Primitive);
    let kind = match array {
        Some(size) => UnresolvedType::Array(Box::new(element), size),
        None => element,
    };
    Ok(Some(UnresolvedField { name, kind }))
}

fn primitive(name: &str, dialect: Dialect) -> Option<Primitive> {
    Some(match name {
        "bool" => Primitive::Bool,
        "byte" if dialect == Dialect::Ros1 => Primitive::Int(1),
        "int8" => Primitive::Int(1),
        "int16" => Primitive::Int(2),
        "int32" => Primitive::Int(4),
        "int64" => Primitive::Int(8),
        "byte" | "char" | "uint8" => Primitive::UInt(1),
        "uint16" => Primitive::UInt(2),
        "uint32" => Primitive::UInt(4),
        "uint64" => Primitive::UInt(8),
        "float32" => Primitive::Float(4),
        "float64" => Primitive::Float(8),
        "string" => Primitive::Text,
        "wstring" => Primitive::WideText,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::super::layout::Type;
    use super::*;

    #[test]
    fn arrays_constants_and_relative_names() {
        let text = "uint8 MODE=1\nHeader header\nBeam[] beams # four\nfloat64[3] v\nstring<=10 \
                    form \"a\"\n===\nMSG: p/Beam\nfloat64 distance\nbool valid\n";
        let layout = parse("p/msg/Dvl", text, Dialect::Ros2).expect("a layout");
        assert!(
            layout.has("header.stamp.nanosec")
                && layout.has("beams.distance")
                && !layout.has("mode")
        );
        assert_eq!(
            layout.type_at("v"),
            Some(&Type::Array(Box::new(Type::Primitive(Primitive::Float(8))), Some(3)))
        );
        let layout = parse("p/Dvl", "Header header\ntime at\n", Dialect::Ros1).expect("a layout");
        assert!(layout.has("header.seq") && layout.has("at.sec"));
    }

    #[test]
    fn recursive_and_deeply_nested_types_are_rejected() {
        let error =
            parse("p/A", "B b\n===\nMSG: p/B\nA a\n", Dialect::Ros2).expect_err("recursion");
        assert!(error.contains("contains itself"), "{error}");
        let chain: String =
            (0..100_000).map(|i| format!("T{} x\n===\nMSG: p/T{}\n", i + 1, i + 1)).collect();
        let error = parse("p/T0", &chain, Dialect::Ros2).expect_err("a chain");
        assert!(error.contains("nests"), "{error}");
    }
}
