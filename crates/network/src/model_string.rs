//! The model strings of the field's checkpoints: one class name and keyword arguments, read and never evaluated.
//!
//! ```text
//! AsymmetricMASt3R(pos_embed='RoPE100', img_size=(512, 512), depth_mode=('exp', -inf, inf), enc_embed_dim=1024, …)
//! ```

use crate::Error;
use crate::config::{ConfidenceMode, DepthMode};
use std::collections::BTreeMap;

/// Longest model string that is read.
const MAX_LEN: usize = 8192;
/// Tuples in tuples.
const MAX_NESTING: usize = 4;

/// Families of networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Points and descriptors.
    Mast3r,
    /// Points.
    Dust3r,
    /// Encoder and one decoder, trained to complete pictures.
    Croco,
}

impl Family {
    /// Its published name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mast3r => "MASt3R",
            Self::Dust3r => "DUSt3R",
            Self::Croco => "CroCo",
        }
    }
}

/// What a model string says. `None` where it is silent.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelString {
    /// By the class name.
    pub family: Family,
    /// Channels of the encoder.
    pub encoder_dim: Option<usize>,
    /// Blocks of the encoder.
    pub encoder_blocks: Option<usize>,
    /// Heads of the encoder.
    pub encoder_heads: Option<usize>,
    /// Channels of the decoders.
    pub decoder_dim: Option<usize>,
    /// Blocks of a decoder.
    pub decoder_blocks: Option<usize>,
    /// Heads of the decoders.
    pub decoder_heads: Option<usize>,
    /// Side of a patch, pixels.
    pub patch_px: Option<usize>,
    /// Hidden channels of an MLP for each of its inputs.
    pub mlp_ratio: Option<usize>,
    /// Base of the rotary positions.
    pub rope_base: Option<f64>,
    /// Channels of a descriptor.
    pub descriptor_dim: Option<usize>,
    /// Distance from the origin.
    pub depth_mode: Option<DepthMode>,
    /// Confidence of the points.
    pub confidence: Option<ConfidenceMode>,
    /// Whether descriptors have a confidence of their own.
    pub two_confidences: Option<bool>,
    /// Confidence of the descriptors.
    pub descriptor_confidence: Option<ConfidenceMode>,
}

/// A value of an argument.
#[derive(Debug, Clone, PartialEq)]
enum Value {
    Text(String),
    Int(i64),
    Float(f64),
    Bool(bool),
    None,
    Tuple(Vec<Value>),
}

/// Arguments that change nothing about the network's function: sizes, storage of portraits, what is trained.
const WITHOUT_EFFECT: [&str; 8] = [
    "patch_embed_cls",
    "img_size",
    "landscape_only",
    "freeze",
    "mask_ratio",
    "norm_im2_in_dec",
    "mode",
    "local_feat_dim",
];
const UNDERSTOOD: &str = "pos_embed, patch_embed_cls, img_size, head_type, output_mode, depth_mode, conf_mode, \
    enc_embed_dim, enc_depth, enc_num_heads, dec_embed_dim, dec_depth, dec_num_heads, two_confs, desc_conf_mode, \
    patch_size, mlp_ratio, freeze, landscape_only";

impl ModelString {
    /// Reads a model string.
    ///
    /// # Errors
    /// [`Error::ModelString`] for another grammar, an unknown class or argument, a value that is not understood.
    pub fn parse(text: &str) -> Result<Self, Error> {
        if text.len() > MAX_LEN {
            return Err(fault("length", "8192 characters at most", &text.len().to_string()));
        }
        let mut parser = Parser { rest: text.trim() };
        let class = parser.word()?;
        let family = match class {
            "AsymmetricMASt3R" => Family::Mast3r,
            "AsymmetricCroCo3DStereo" => Family::Dust3r,
            "CroCoNet" => Family::Croco,
            other => {
                let expected = "AsymmetricMASt3R, AsymmetricCroCo3DStereo (DUSt3R) or CroCoNet";
                return Err(fault("class", expected, other));
            }
        };
        let mut read = Self::silent(family);
        let mut seen = BTreeMap::new();
        parser.expect('(')?;
        while !parser.eat(')') {
            let name = parser.word()?.to_owned();
            parser.expect('=')?;
            let value = parser.value(0)?;
            read.set(&name, &value)?;
            if seen.insert(name.clone(), ()).is_some() {
                return Err(fault(&format!("argument {name}"), "it once", "it twice"));
            }
            if !parser.eat(',') {
                parser.expect(')')?;
                break;
            }
        }
        if parser.rest.trim().is_empty() { Ok(read) } else { Err(parser.fault("the end")) }
    }

    fn silent(family: Family) -> Self {
        Self {
            family,
            encoder_dim: None,
            encoder_blocks: None,
            encoder_heads: None,
            decoder_dim: None,
            decoder_blocks: None,
            decoder_heads: None,
            patch_px: None,
            mlp_ratio: None,
            rope_base: None,
            descriptor_dim: None,
            depth_mode: None,
            confidence: None,
            two_confidences: None,
            descriptor_confidence: None,
        }
    }

    fn set(&mut self, name: &str, value: &Value) -> Result<(), Error> {
        let argument = Argument { name, value };
        match name {
            "enc_embed_dim" => self.encoder_dim = argument.size()?,
            "enc_depth" => self.encoder_blocks = argument.size()?,
            "enc_num_heads" => self.encoder_heads = argument.size()?,
            "dec_embed_dim" => self.decoder_dim = argument.size()?,
            "dec_depth" => self.decoder_blocks = argument.size()?,
            "dec_num_heads" => self.decoder_heads = argument.size()?,
            "patch_size" => self.patch_px = argument.size()?,
            "mlp_ratio" => self.mlp_ratio = argument.size()?,
            "pos_embed" => self.rope_base = Some(argument.rope_base()?),
            "head_type" => argument.head(self.family)?,
            "output_mode" => self.descriptor_dim = argument.descriptor_dim(self.family)?,
            "depth_mode" => self.depth_mode = Some(argument.depth_mode()?),
            "conf_mode" => self.confidence = Some(argument.confidence()?),
            "desc_conf_mode" => self.descriptor_confidence = Some(argument.confidence()?),
            "two_confs" => match value {
                Value::Bool(value) => self.two_confidences = Some(*value),
                _ => return Err(argument.fault("True or False")),
            },
            name if WITHOUT_EFFECT.contains(&name) => {}
            name => return Err(fault("argument", UNDERSTOOD, name)),
        }
        Ok(())
    }
}

struct Argument<'a> {
    name: &'a str,
    value: &'a Value,
}

impl Argument<'_> {
    fn fault(&self, expected: &str) -> Error {
        fault(&format!("argument {}", self.name), expected, &show(self.value))
    }

    fn size(&self) -> Result<Option<usize>, Error> {
        match self.value {
            Value::Int(value) if (1..=1 << 20).contains(value) => Ok(Some(value.unsigned_abs() as usize)),
            Value::Float(value) if value.fract() == 0.0 && (1.0..=1024.0).contains(value) => {
                Ok(Some(*value as usize))
            }
            _ => Err(self.fault("a whole number from 1 on")),
        }
    }

    fn text(&self, expected: &str) -> Result<&str, Error> {
        match self.value {
            Value::Text(text) => Ok(text),
            _ => Err(self.fault(expected)),
        }
    }

    fn rope_base(&self) -> Result<f64, Error> {
        let expected = "'RoPE100' or another base";
        let base = self.text(expected)?.strip_prefix("RoPE").and_then(|base| base.parse::<f64>().ok());
        base.filter(|base| (1.0..1e9).contains(base) && *base > 1.0).ok_or_else(|| self.fault(expected))
    }

    fn head(&self, family: Family) -> Result<(), Error> {
        let expected = if family == Family::Mast3r { "catmlp+dpt" } else { "dpt" };
        if self.text(expected)? == expected { Ok(()) } else { Err(self.fault(&format!("'{expected}'"))) }
    }

    fn descriptor_dim(&self, family: Family) -> Result<Option<usize>, Error> {
        let expected = if family == Family::Mast3r { "'pts3d+desc24' or another size" } else { "'pts3d'" };
        let text = self.text(expected)?;
        match text.strip_prefix("pts3d+desc").map(str::parse::<usize>) {
            Some(Ok(dim)) if family == Family::Mast3r && (1..=1024).contains(&dim) => Ok(Some(dim)),
            None if family != Family::Mast3r && text == "pts3d" => Ok(None),
            _ => Err(self.fault(expected)),
        }
    }

    /// `(mode, least, most)`.
    fn mode(&self, expected: &str) -> Result<(&str, f64, f64), Error> {
        let number = |value: &Value| match value {
            Value::Int(value) => Some(*value as f64),
            Value::Float(value) => Some(*value),
            _ => None,
        };
        if let Value::Tuple(parts) = self.value
            && let [Value::Text(mode), min, max] = &parts[..]
            && let (Some(min), Some(max)) = (number(min), number(max))
        {
            return Ok((mode, min, max));
        }
        Err(self.fault(expected))
    }

    fn depth_mode(&self) -> Result<DepthMode, Error> {
        let expected = "('exp', -inf, inf), or 'linear' or 'square' in it";
        match self.mode(expected)? {
            ("exp", f64::NEG_INFINITY, f64::INFINITY) => Ok(DepthMode::Exp),
            ("linear", f64::NEG_INFINITY, f64::INFINITY) => Ok(DepthMode::Linear),
            ("square", f64::NEG_INFINITY, f64::INFINITY) => Ok(DepthMode::Square),
            _ => Err(self.fault(expected)),
        }
    }

    fn confidence(&self) -> Result<ConfidenceMode, Error> {
        let expected = "('exp', least, most) or ('sigmoid', least, most)";
        match self.mode(expected)? {
            ("exp", min, max) if min.is_finite() && max > min => Ok(ConfidenceMode::Exp { min, max }),
            ("sigmoid", min, max) if min.is_finite() && max.is_finite() && max > min => {
                Ok(ConfidenceMode::Sigmoid { min, max })
            }
            _ => Err(self.fault(expected)),
        }
    }
}

struct Parser<'a> {
    rest: &'a str,
}

impl<'a> Parser<'a> {
    fn fault(&self, expected: &str) -> Error {
        let found: String = self.rest.trim().chars().take(24).collect();
        fault("grammar", expected, if found.is_empty() { "the end" } else { &found })
    }

    fn eat(&mut self, sign: char) -> bool {
        self.rest = self.rest.trim_start();
        let rest = self.rest.strip_prefix(sign);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn expect(&mut self, sign: char) -> Result<(), Error> {
        if self.eat(sign) { Ok(()) } else { Err(self.fault(&format!("`{sign}`"))) }
    }

    fn word(&mut self) -> Result<&'a str, Error> {
        self.rest = self.rest.trim_start();
        let end =
            self.rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        if word.is_empty() || word.starts_with(|c: char| c.is_ascii_digit()) {
            return Err(self.fault("a name"));
        }
        self.rest = rest;
        Ok(word)
    }

    fn value(&mut self, nesting: usize) -> Result<Value, Error> {
        self.rest = self.rest.trim_start();
        for quote in ['\'', '"'] {
            if self.eat(quote) {
                let end = self.rest.find(quote).ok_or_else(|| self.fault("a closing quote"))?;
                let text = self.rest[..end].to_owned();
                self.rest = &self.rest[end + 1..];
                return Ok(Value::Text(text));
            }
        }
        for (open, close) in [('(', ')'), ('[', ']')] {
            if nesting < MAX_NESTING && self.eat(open) {
                let mut parts = Vec::new();
                while !self.eat(close) {
                    parts.push(self.value(nesting + 1)?);
                    if !self.eat(',') {
                        self.expect(close)?;
                        break;
                    }
                }
                return Ok(Value::Tuple(parts));
            }
        }
        let end = self.rest.find([',', ')', ']', ' ']).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        let value = match word {
            "True" => Value::Bool(true),
            "False" => Value::Bool(false),
            "None" => Value::None,
            "inf" => Value::Float(f64::INFINITY),
            "-inf" => Value::Float(f64::NEG_INFINITY),
            _ => match (word.parse::<i64>(), word.parse::<f64>()) {
                (Ok(value), _) => Value::Int(value),
                (_, Ok(value)) if value.is_finite() => Value::Float(value),
                _ => return Err(self.fault("a text, a number, True, False, None, inf or a tuple of them")),
            },
        };
        self.rest = rest;
        Ok(value)
    }
}

fn fault(what: &str, expected: &str, found: &str) -> Error {
    Error::ModelString { what: what.to_owned(), expected: expected.to_owned(), found: found.to_owned() }
}

fn show(value: &Value) -> String {
    match value {
        Value::Text(text) => format!("'{text}'"),
        Value::Int(value) => value.to_string(),
        Value::Float(value) => value.to_string(),
        Value::Bool(value) => if *value { "True" } else { "False" }.to_owned(),
        Value::None => "None".to_owned(),
        Value::Tuple(parts) => format!("({})", parts.iter().map(show).collect::<Vec<_>>().join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const OFFICIAL: &str = "AsymmetricMASt3R(pos_embed='RoPE100', patch_embed_cls='ManyAR_PatchEmbed', \
        img_size=(512, 512), head_type='catmlp+dpt', output_mode='pts3d+desc24', depth_mode=('exp', -inf, inf), \
        conf_mode=('exp', 1, inf), enc_embed_dim=1024, enc_depth=24, enc_num_heads=16, dec_embed_dim=768, \
        dec_depth=12, dec_num_heads=12, two_confs=True, desc_conf_mode=('exp', 0, inf), freeze='encoder')";

    #[test]
    fn the_published_string_is_read() {
        let read = ModelString::parse(OFFICIAL).unwrap();
        assert_eq!(read.family, Family::Mast3r);
        assert_eq!(
            (read.encoder_dim, read.encoder_blocks, read.encoder_heads),
            (Some(1024), Some(24), Some(16))
        );
        assert_eq!(
            (read.decoder_dim, read.decoder_blocks, read.decoder_heads),
            (Some(768), Some(12), Some(12))
        );
        assert_eq!((read.rope_base, read.descriptor_dim), (Some(100.0), Some(24)));
        assert_eq!(read.confidence, Some(ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY }));
        assert_eq!(read.two_confidences, Some(true));
    }

    #[test]
    fn strangers_are_named_with_what_was_expected() {
        let cases = [
            ("os.system('rm')", "AsymmetricMASt3R"),
            ("'os'", "grammar"),
            ("Evil(a=1)", "AsymmetricMASt3R"),
            ("AsymmetricMASt3R(layers=3)", "enc_embed_dim"),
            ("AsymmetricMASt3R(enc_depth='many')", "whole number"),
            ("AsymmetricMASt3R(enc_depth=-1)", "whole number"),
            ("AsymmetricMASt3R(enc_depth=2, enc_depth=2)", "twice"),
            ("AsymmetricMASt3R(head_type='linear')", "catmlp+dpt"),
            ("AsymmetricMASt3R(output_mode='pts3d')", "pts3d+desc24"),
            ("AsymmetricMASt3R(pos_embed='cosine')", "RoPE100"),
            ("AsymmetricMASt3R(conf_mode=('exp', 1))", "least"),
            ("AsymmetricMASt3R(img_size=((((((1", "tuple"),
            ("AsymmetricMASt3R(two_confs=__import__('os'))", "True"),
            ("AsymmetricMASt3R()x", "end"),
            ("AsymmetricMASt3R(", "name"),
        ];
        for (text, expected) in cases {
            let error = ModelString::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
        assert!(ModelString::parse("AsymmetricCroCo3DStereo(head_type='dpt', output_mode='pts3d')").is_ok());
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "\\PC{0,200}", cut in 0usize..600) {
            let _ = ModelString::parse(&text);
            let _ = ModelString::parse(&format!("AsymmetricMASt3R({text}"));
            let _ = ModelString::parse(&OFFICIAL[..cut.min(OFFICIAL.len())]);
        }
    }
}
