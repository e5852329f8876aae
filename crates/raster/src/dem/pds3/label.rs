//! Text labels of PDS3: the object description language.
//!
//! # Source
//! PDS Standards Reference 3.8, chapter 12, "Object description language".

/// A value of a keyword.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    /// A word, number or quoted text, with the unit that stood in angle brackets.
    Scalar { text: String, unit: Option<String> },
    /// A sequence or set.
    List(Vec<Value>),
}

impl Value {
    /// The text of a scalar, or of a list's first element.
    pub(crate) fn text(&self) -> &str {
        match self {
            Self::Scalar { text, .. } => text,
            Self::List(items) => items.first().map_or("", Self::text),
        }
    }

    /// The unit of a scalar.
    pub(crate) fn unit(&self) -> Option<&str> {
        match self {
            Self::Scalar { unit, .. } => unit.as_deref(),
            Self::List(items) => items.first().and_then(Self::unit),
        }
    }

    /// The scalars of a list, or the scalar itself.
    pub(crate) fn items(&self) -> Vec<&Value> {
        match self {
            Self::Scalar { .. } => vec![self],
            Self::List(items) => items.iter().flat_map(Self::items).collect(),
        }
    }

    fn set_unit(&mut self, of_list: &str) {
        match self {
            Self::Scalar { unit, .. } => drop(unit.get_or_insert_with(|| of_list.to_owned())),
            Self::List(items) => items.iter_mut().for_each(|item| item.set_unit(of_list)),
        }
    }

    /// The number, decimal or with a radix (`16#FF7FFFFB#`, taken as an integer).
    pub(crate) fn number(&self) -> Option<f64> {
        let text = self.text();
        if let Some(bits) = self.bits() {
            return Some(bits as f64);
        }
        text.parse::<f64>().ok().filter(|v| v.is_finite())
    }

    /// The digits of a number with a radix.
    pub(crate) fn bits(&self) -> Option<u64> {
        let (radix, digits) = self.text().split_once('#')?;
        let radix = radix.parse().ok().filter(|r| (2..=36).contains(r))?;
        u64::from_str_radix(digits.trim_end_matches('#'), radix).ok()
    }
}

/// An object or group: its keywords and what it contains.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Block {
    pub(crate) name: String,
    pub(crate) entries: Vec<(String, Value)>,
    pub(crate) blocks: Vec<Block>,
}

impl Block {
    /// The value of a keyword of this block (upper case).
    pub(crate) fn get(&self, key: &str) -> Option<&Value> {
        self.entries.iter().find(|(k, _)| k == key).map(|(_, v)| v)
    }

    /// The first block of that name, here or further inside.
    pub(crate) fn find_block(&self, name: &str) -> Option<&Block> {
        self.walk().find(|block| block.name == name)
    }

    /// The first keyword of that name, here or further inside.
    pub(crate) fn find(&self, key: &str) -> Option<&Value> {
        self.walk().find_map(|block| block.get(key))
    }

    fn walk(&self) -> impl Iterator<Item = &Block> {
        let mut stack = vec![self];
        std::iter::from_fn(move || {
            let block = stack.pop()?;
            stack.extend(block.blocks.iter().rev());
            Some(block)
        })
    }
}

/// Parses a label up to its `END`; the error says what was expected and found.
pub(crate) fn parse(text: &str) -> Result<Block, (String, String)> {
    let mut scanner = Scanner { rest: text };
    let mut stack = vec![Block::default()];
    loop {
        let key = scanner.key();
        if key.is_empty() {
            let found = scanner.rest.chars().take(12).collect::<String>();
            let expected = "a keyword, or END after the last".to_owned();
            return Err((expected, if found.is_empty() { "the end of the label".to_owned() } else { found }));
        }
        if key == "END" {
            return match stack.pop() {
                Some(label) if stack.is_empty() => Ok(label),
                block => {
                    let name = block.map_or_else(String::new, |b| b.name);
                    Err((format!("END_OBJECT = {name}"), "END".to_owned()))
                }
            };
        }
        let value =
            if scanner.eat('=') { Some(scanner.value().ok_or_else(|| unfinished(&key))?) } else { None };
        match (key.as_str(), value) {
            ("OBJECT" | "GROUP" | "BEGIN_OBJECT" | "BEGIN_GROUP", Some(name)) => {
                stack.push(Block { name: name.text().to_ascii_uppercase(), ..Block::default() });
            }
            ("END_OBJECT" | "END_GROUP", _) => match (stack.pop(), stack.last_mut()) {
                (Some(block), Some(parent)) => parent.blocks.push(block),
                _ => return Err(("an OBJECT before its END_OBJECT".to_owned(), key)),
            },
            (_, Some(value)) => {
                if let Some(block) = stack.last_mut() {
                    block.entries.push((key, value));
                }
            }
            (_, None) => return Err((format!("= after {key}"), "nothing".to_owned())),
        }
    }
}

fn unfinished(key: &str) -> (String, String) {
    (format!("a value for {key}"), "the end of the label".to_owned())
}

struct Scanner<'a> {
    rest: &'a str,
}

/// Lists inside lists that a label may have.
const MAX_DEPTH: usize = 8;

impl Scanner<'_> {
    fn skip_blank(&mut self) {
        loop {
            self.rest = self.rest.trim_start_matches(|c: char| c.is_whitespace() || c == '\0');
            let Some(comment) = self.rest.strip_prefix("/*") else { return };
            self.rest = comment.split_once("*/").map_or("", |(_, after)| after);
        }
    }

    fn eat(&mut self, c: char) -> bool {
        self.skip_blank();
        match self.rest.strip_prefix(c) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    fn take_while(&mut self, accept: impl Fn(char) -> bool) -> String {
        let end = self.rest.find(|c| !accept(c)).unwrap_or(self.rest.len());
        let (taken, rest) = self.rest.split_at(end);
        self.rest = rest;
        taken.to_owned()
    }

    fn key(&mut self) -> String {
        self.skip_blank();
        self.take_while(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '^' | ':')).to_ascii_uppercase()
    }

    fn value(&mut self) -> Option<Value> {
        self.value_at(0)
    }

    fn value_at(&mut self, level: usize) -> Option<Value> {
        self.skip_blank();
        if level < MAX_DEPTH && self.rest.starts_with(['(', '{']) {
            return self.list(level);
        }
        let quote = self.rest.chars().next()?;
        let text = if matches!(quote, '"' | '\'') {
            let (text, rest) = self.rest[1..].split_once(quote)?;
            self.rest = rest;
            text.split_whitespace().collect::<Vec<_>>().join(" ")
        } else {
            self.take_while(|c| !c.is_whitespace() && !matches!(c, ',' | ')' | '}' | '<' | '=' | '\0'))
        };
        let unit = self.unit()?;
        if text.is_empty() && !matches!(quote, '"' | '\'') {
            return None;
        }
        Some(Value::Scalar { text, unit })
    }

    /// A unit in angle brackets, which may stand on the next line; `None` outside if it does not end.
    #[allow(clippy::option_option, reason = "no unit is no error")]
    fn unit(&mut self) -> Option<Option<String>> {
        if !self.eat('<') {
            return Some(None);
        }
        let (unit, rest) = self.rest.split_once('>')?;
        self.rest = rest;
        Some(Some(unit.trim().to_owned()))
    }

    fn list(&mut self, level: usize) -> Option<Value> {
        self.rest = &self.rest[1..];
        let mut items = Vec::new();
        loop {
            if self.eat(')') || self.eat('}') {
                // A unit behind the list is that of all its elements.
                if let Some(unit) = self.unit()? {
                    items.iter_mut().for_each(|item: &mut Value| item.set_unit(&unit));
                }
                return Some(Value::List(items));
            }
            items.push(self.value_at(level + 1)?);
            self.eat(',');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn objects_units_lists_and_comments() {
        let label = parse(
            "PDS_VERSION_ID = PDS3\r\n/* a comment = 1 */\r\n^IMAGE = (\"A.IMG\", 5 <BYTES>)\r\n\
             MISSION = {\"ONE\",\r\n \"TWO\"}\r\nOBJECT = IMAGE\r\n LINES = 720\r\n  NOTE = \"two\r\n   lines\"\r\n\
             CORE_NULL = 16#FF7FFFFB#\r\n OFFSET = 1737.4 <KM>\r\nEND_OBJECT = IMAGE\r\nEND\r\n\0binary\u{1}",
        )
        .unwrap();
        let Some(Value::List(pointer)) = label.get("^IMAGE") else { panic!("no pointer") };
        assert_eq!(pointer[0].text(), "A.IMG");
        assert_eq!((pointer[1].number(), pointer[1].unit()), (Some(5.0), Some("BYTES")));
        let image = label.find_block("IMAGE").unwrap();
        assert_eq!(image.get("LINES").unwrap().number(), Some(720.0));
        assert_eq!(image.get("NOTE").unwrap().text(), "two lines");
        assert_eq!(image.get("CORE_NULL").unwrap().bits(), Some(0xFF7F_FFFB));
        assert_eq!(label.find("OFFSET").unwrap().unit(), Some("KM"));
    }

    #[test]
    fn units_stand_after_lists_and_on_the_next_line() {
        let label = parse(
            "BANDWIDTH = (27.0, 28.0 <um>) <nm>\r\nCOEF = (0.1 <a>, 0.2\r\n   <b>)\r\nEXPOSURE = 0.1\r\n  /* c */ <ms>\r\n\
             SET = {1,\r\n 2}\r\n <px>\r\nEND\r\n",
        )
        .unwrap();
        let units = |key: &str| label.get(key).unwrap().items().iter().map(|v| v.unit()).collect::<Vec<_>>();
        assert_eq!(units("BANDWIDTH"), [Some("nm"), Some("um")]);
        assert_eq!(units("COEF"), [Some("a"), Some("b")]);
        assert_eq!((units("EXPOSURE"), units("SET")), (vec![Some("ms")], vec![Some("px"); 2]));
    }

    #[test]
    fn unfinished_labels_are_refused() {
        for text in [
            "",
            "A",
            "A =",
            "A = \"x",
            "A = (1, 2",
            "A = 1 <km",
            "A = (1) <km",
            "OBJECT = X\nA = 1\nEND\n",
            "A = 1\n",
            "END_OBJECT\nEND",
        ] {
            assert!(parse(text).is_err(), "{text:?}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "[A-Z=(){}<>\"'#/* \n0-9^,é]{0,80}") {
            let _ = parse(&text);
        }
    }
}
