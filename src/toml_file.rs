//! TOML files that a user writes: an unknown key is an error that names the nearest known key.

use serde::de::value::{Error, MapDeserializer, SeqDeserializer};
use serde::de::{DeserializeOwned, Deserializer, Error as _, IntoDeserializer, Visitor};

/// Parses a file's text.
///
/// # Errors
/// A sentence: what is wrong with the text, or with which key.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    let sentence = |e: toml::de::Error| e.to_string().trim().to_string();
    let table: toml::Table = text.parse().map_err(sentence)?;
    let known = keys::<T>();
    if let Some(unknown) = unknown_key("", &table, &known) {
        let nearest = nearest_key(&unknown, &known).unwrap_or_default();
        return Err(format!("unknown key `{unknown}`; did you mean `{nearest}`?"));
    }
    toml::from_str(text).map_err(sentence)
}

/// The first key of a table that is not among the known ones. Keys below one that has none of its
/// own are free, as topics are.
fn unknown_key(path: &str, table: &toml::Table, known: &[String]) -> Option<String> {
    let is_known = |key: &str| known.iter().any(|k| k == key);
    let has_keys = |key: &str| {
        known.iter().any(|k| k.strip_prefix(key).is_some_and(|rest| rest.starts_with('.')))
    };
    table.iter().find_map(|(key, value)| {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        if !is_known(&path) {
            return Some(path);
        }
        let inner = match value {
            toml::Value::Array(items) => items.as_slice(),
            other => std::slice::from_ref(other),
        };
        let mut tables = inner.iter().filter_map(toml::Value::as_table);
        if has_keys(&path) { tables.find_map(|t| unknown_key(&path, t, known)) } else { None }
    })
}

/// The known key whose last part, then whose path, is most similar.
fn nearest_key<'k>(unknown: &str, known: &'k [String]) -> Option<&'k str> {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_string();
    let similarity = |key: &str| {
        let of_name = strsim::jaro_winkler(&last(key), &last(unknown));
        (of_name, strsim::jaro_winkler(key, unknown))
    };
    known
        .iter()
        .map(|key| (similarity(key), key.as_str()))
        .max_by(|((a, b), _), ((c, d), _)| a.total_cmp(c).then(b.total_cmp(d)))
        .map(|(_, key)| key)
}

/// Dotted paths of the keys that a type is read from, by its `Deserialize`.
fn keys<T: DeserializeOwned>() -> Vec<String> {
    let mut found = Vec::new();
    collect_keys::<T>(&mut Vec::new(), &mut found);
    found
}

fn collect_keys<T: DeserializeOwned>(path: &mut Vec<&'static str>, found: &mut Vec<String>) {
    let mut fields: &[&str] = &[];
    let _stopped_at_the_path = T::deserialize(Probe { path, fields: &mut fields });
    for field in fields {
        path.push(field);
        found.push(path.join("."));
        collect_keys::<T>(path, found);
        path.pop();
    }
}

/// A deserializer that walks along a path of fields and takes down the fields of the struct there.
struct Probe<'p> {
    path: &'p [&'static str],
    fields: &'p mut &'static [&'static str],
}

impl IntoDeserializer<'_> for Probe<'_> {
    type Deserializer = Self;
    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for Probe<'_> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(Error::custom("a value"))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_seq(SeqDeserializer::new(std::iter::once(self)))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        match self.path.split_first() {
            Some((field, path)) => {
                let inner = Probe { path, fields: self.fields };
                visitor.visit_map(MapDeserializer::new(std::iter::once((*field, inner))))
            }
            None => {
                *self.fields = fields;
                Err(Error::custom("the struct at the path"))
            }
        }
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct newtype_struct tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Default, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    #[allow(dead_code)]
    struct Part {
        length_m: f64,
        weight_kg: Option<f64>,
    }

    #[derive(Debug, Default, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    #[allow(dead_code)]
    struct Whole {
        first: Part,
        second: Option<Part>,
        others: Option<Vec<Part>>,
        by_topic: std::collections::BTreeMap<String, f64>,
    }

    #[test]
    fn keys_are_those_of_the_type_and_of_all_types_within() {
        let own = ["first", "second", "others"];
        let mut expected: Vec<String> = own
            .iter()
            .flat_map(|s| [s.to_string(), format!("{s}.length_m"), format!("{s}.weight_kg")])
            .collect();
        expected.push("by_topic".into());
        assert_eq!(keys::<Whole>(), expected);
    }

    #[test]
    fn an_unknown_key_is_named_with_its_nearest_also_in_a_list() {
        let error = |text: &str| parse::<Whole>(text).expect_err(text);
        let suggestion = "unknown key `others.weight`; did you mean `others.weight_kg`?";
        assert_eq!(error("[[others]]\nlength_m = 1.0\n[[others]]\nweight = 1.0"), suggestion);
        assert!(error("[frist]\n").contains("`first`"));
        assert!(error("first.length_m = 'long'").contains("expected"));
        parse::<Whole>("[by_topic]\n\"/dvl/data\" = 1.0").expect("topics are free");
    }
}
