//! Tables of text: CSV with a header, or the items of an iFDO record. Names of columns are compared
//! without case, units and punctuation.

use serde_json::Value as Json;

/// A table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// as in the file
    pub columns: Vec<String>,
    /// cells by row; a row may be shorter than the header
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// Reads CSV (RFC 4180; semicolons and tabs too), or an iFDO record in JSON.
    ///
    /// # Errors
    /// A sentence: why it is neither.
    pub fn parse(text: &str) -> Result<Self, String> {
        let text = text.trim_start_matches('\u{feff}');
        if text.trim_start().starts_with('{') { Self::of_ifdo(text) } else { Self::of_csv(text) }
    }

    fn of_csv(text: &str) -> Result<Self, String> {
        let head = text.lines().next().unwrap_or_default();
        let count = |separator: &char| head.matches(*separator).count();
        let separator = [',', ';', '\t'].into_iter().max_by_key(count).unwrap_or(',');
        let mut rows = cells(text, separator)?;
        rows.retain(|row| row.iter().any(|cell| !cell.trim().is_empty()));
        if rows.len() < 2 {
            return Err("it has no rows below its header".into());
        }
        let columns = rows.remove(0).iter().map(|name| name.trim().to_string()).collect();
        Ok(Self { columns, rows })
    }

    fn of_ifdo(text: &str) -> Result<Self, String> {
        let record: Json = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let items = record.get("image-set-items").and_then(Json::as_object);
        let items = items.ok_or("it is JSON without image-set-items")?;
        let mut table = Self { columns: vec!["filename".into()], rows: Vec::new() };
        for (name, item) in items {
            // Of a video, or of an item with several entries, the first.
            let item = item.as_array().and_then(|list| list.first()).unwrap_or(item);
            let mut row = vec![name.clone()];
            for (key, value) in item.as_object().into_iter().flatten() {
                let text = match value {
                    Json::String(text) => text.clone(),
                    Json::Number(number) => number.to_string(),
                    _ => continue,
                };
                let at = table.columns.iter().position(|column| column == key);
                let at = at.unwrap_or_else(|| {
                    table.columns.push(key.clone());
                    table.columns.len() - 1
                });
                row.resize(row.len().max(at + 1), String::new());
                row[at] = text;
            }
            table.rows.push(row);
        }
        if table.rows.is_empty() { Err("it has no items".into()) } else { Ok(table) }
    }

    /// Index of the first column of any of these plain names, in their order.
    pub fn column(&self, names: &[&str]) -> Option<usize> {
        let plain: Vec<String> = self.columns.iter().map(|name| plain(name)).collect();
        names.iter().find_map(|name| plain.iter().position(|column| column == name))
    }

    /// A cell; `None` where it is empty.
    pub fn cell<'t>(&self, row: &'t [String], column: Option<usize>) -> Option<&'t str> {
        let cell = row.get(column?)?.trim();
        (!cell.is_empty()).then_some(cell)
    }
}

/// `Latitude [deg]` → `latitude`, `image-latitude` → `imagelatitude`
fn plain(name: &str) -> String {
    let without_unit = name.split(['[', '(']).next().unwrap_or_default();
    without_unit.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// The unit in a column's name: `heading [rad]` → `rad`.
pub fn unit(name: &str) -> Option<&str> {
    name.split_once(['[', '('])?.1.split([']', ')']).next().map(str::trim)
}

/// Rows of cells; quotes enclose separators and line ends, and are doubled inside.
fn cells(text: &str, separator: char) -> Result<Vec<Vec<String>>, String> {
    let (mut rows, mut row, mut cell) = (Vec::new(), Vec::new(), String::new());
    let mut is_quoted = false;
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if is_quoted && chars.peek() == Some(&'"') => cell.extend(chars.next()),
            '"' if is_quoted => is_quoted = false,
            '"' if cell.is_empty() => is_quoted = true,
            '\n' if !is_quoted => {
                row.push(std::mem::take(&mut cell));
                rows.push(std::mem::take(&mut row));
            }
            '\r' if !is_quoted => {}
            c if c == separator && !is_quoted => row.push(std::mem::take(&mut cell)),
            c => cell.push(c),
        }
    }
    if is_quoted {
        return Err("a quotation does not end".into());
    }
    row.push(cell);
    rows.push(row);
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_may_be_quoted_and_separated_by_semicolons() {
        let table = Table::parse("File;Depth [m];note\r\na.jpg;3,5;\"x;\"\"y\"\"\"\r\n\r\n");
        let table = table.expect("a table");
        assert_eq!(table.rows, [["a.jpg", "3,5", "x;\"y\""]]);
        assert_eq!((table.column(&["depth"]), unit(&table.columns[1])), (Some(1), Some("m")));
        assert!(Table::parse("a,b\n\"c").is_err() && Table::parse("a,b\n").is_err());
    }

    #[test]
    fn an_ifdo_record_is_a_table() {
        let record = r#"{"image-set-items": {"a.jpg": {"image-latitude": 60.5},
            "b.jpg": [{"image-datetime": "2020-01-01 00:00:00.0", "image-latitude": 61}]}}"#;
        let table = Table::parse(record).expect("a table");
        assert_eq!(table.columns, ["filename", "image-latitude", "image-datetime"]);
        let second = &table.rows[1];
        assert_eq!(table.cell(second, table.column(&["imagelatitude"])), Some("61"));
    }
}
