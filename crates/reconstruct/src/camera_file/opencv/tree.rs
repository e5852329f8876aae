//! YAML, XML and JSON as one kind of tree.

use serde_json::Value;

/// A key without case and underscores: `image_Width`, `imageWidth` and `image_width` are one.
pub(super) fn plain(key: &str) -> String {
    key.chars().filter(|c| *c != '_').flat_map(char::to_lowercase).collect()
}

/// What stands behind a key.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node(Value);

/// The keys of a document or of a part of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Keys(Vec<(String, Node)>);

impl Keys {
    fn new(value: Value) -> Option<Self> {
        let Value::Object(map) = value else { return None };
        Some(Self(map.into_iter().map(|(key, value)| (plain(&key), Node(value))).collect()))
    }

    /// The first of these keys that is there.
    pub fn get(&self, names: &[&str]) -> Option<&Node> {
        names.iter().find_map(|name| self.0.iter().find(|(key, _)| key == name)).map(|(_, node)| node)
    }
}

impl Node {
    pub fn keys(&self) -> Option<Keys> {
        Keys::new(self.0.clone())
    }

    pub fn number(&self) -> Option<f64> {
        number(&self.0)
    }

    pub fn text(&self) -> Option<&str> {
        self.0.as_str()
    }

    /// The numbers of a list, or what is none.
    pub fn numbers(&self) -> Result<Vec<f64>, String> {
        let number = |value: &Value| number(value).ok_or_else(|| shown(value));
        match &self.0 {
            Value::Array(list) => list.iter().map(number).collect(),
            // XML has its numbers in one text.
            Value::String(text) => {
                text.split_whitespace().map(|word| word.parse().map_err(|_| format!("`{word}`"))).collect()
            }
            other => Err(shown(other)),
        }
    }

    pub fn shown(&self) -> String {
        shown(&self.0)
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        // JSON has no such number, and its tree none either.
        Value::Null => Some(f64::NAN),
        Value::String(text) => text.trim().parse().ok(),
        other => other.as_f64(),
    }
}

fn shown(value: &Value) -> String {
    value.to_string().chars().take(60).collect()
}

/// The documents of a file; the empty ones that end a stream are left out.
pub(super) fn documents(text: &str) -> Result<Vec<Keys>, String> {
    let values = if text.trim_start().starts_with('<') { vec![xml(text)?] } else { yaml(text)? };
    values
        .into_iter()
        .filter(|value| !value.is_null())
        .map(|value| Keys::new(value.clone()).ok_or_else(|| shown(&value)))
        .collect()
}

/// JSON is YAML too. OpenCV writes a first line that only resembles YAML's own.
fn yaml(text: &str) -> Result<Vec<Value>, String> {
    let start = text.trim_start();
    let start =
        if start.starts_with("%YAML") { start.split_once('\n').map_or("", |(_, rest)| rest) } else { start };
    serde_saphyr::from_multiple::<Value>(start).map_err(|e| {
        let text = e.to_string();
        text.lines().next().unwrap_or_default().to_owned()
    })
}

fn xml(text: &str) -> Result<Value, String> {
    let document = roxmltree::Document::parse(text).map_err(|e| e.to_string())?;
    let root = document.root_element();
    if root.tag_name().name() != "opencv_storage" {
        return Err(format!("XML of `{}`", root.tag_name().name()));
    }
    Ok(element(root, 0))
}

/// Elements nest in OpenCV's files, but not deeply.
const DEEPEST: usize = 16;

fn element(node: roxmltree::Node<'_, '_>, level: usize) -> Value {
    let children = node.children().filter(roxmltree::Node::is_element);
    let map: serde_json::Map<String, Value> = children
        .filter(|_| level < DEEPEST)
        .map(|child| (child.tag_name().name().to_owned(), element(child, level + 1)))
        .collect();
    if map.is_empty() {
        Value::String(node.text().unwrap_or_default().trim().to_owned())
    } else {
        Value::Object(map)
    }
}
