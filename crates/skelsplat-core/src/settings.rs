//! The definition of a setting: name, default, unit, domain and a one-sentence description, each
//! written once.
//!
//! [`settings!`] generates a struct of settings from one line per field, with its documentation,
//! its defaults and a table of [`Setting`]s, from which the bindings read, write and describe the
//! settings.

use crate::error::{Error, Result};

/// The value of a setting.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A number.
    Number(f64),
    /// A whole number.
    Count(usize),
    /// A flag.
    Switch(bool),
    /// One of several names.
    Name(&'static str),
    /// Several numbers.
    Numbers(Vec<f64>),
    /// No value; the setting defines the meaning.
    Nothing,
}

impl std::fmt::Display for Value {
    /// In Python notation; long numbers are rounded.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let number = |x: f64| match x.to_string() {
            text if text.len() <= 6 => text,
            _ if x.abs() >= 1e-3 && x.abs() < 1e6 => format!("{x:.2}"),
            _ => format!("{x:e}"),
        };
        match self {
            Self::Number(x) => f.write_str(&number(*x)),
            Self::Count(n) => write!(f, "{n}"),
            Self::Switch(on) => f.write_str(if *on { "True" } else { "False" }),
            Self::Name(name) => write!(f, "\"{name}\""),
            Self::Numbers(all) => {
                let shown: Vec<String> = all.iter().map(|x| number(*x)).collect();
                write!(f, "({})", shown.join(", "))
            }
            Self::Nothing => f.write_str("None"),
        }
    }
}

/// The kinds of values that a setting accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// [`Value::Number`].
    Number,
    /// A number or [`Value::Nothing`].
    NumberOrNothing,
    /// [`Value::Count`].
    Count,
    /// A whole number or [`Value::Nothing`].
    CountOrNothing,
    /// [`Value::Switch`].
    Switch,
    /// Two numbers.
    Pair,
    /// Any number of numbers, or [`Value::Nothing`].
    NumbersOrNothing,
    /// A number for all, any number of numbers, or [`Value::Nothing`].
    OneOrEach,
    /// One of these names.
    Name(&'static [&'static str]),
    /// A number or this name.
    NumberOrName(&'static str),
}

/// The range of the numbers of a setting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Domain {
    /// Any value of its kind.
    Any,
    /// Positive, from 1e-15 to 1e9.
    Positive,
    /// Positive, from this to 1e9.
    From(f64),
    /// Not negative, at most 1e9.
    NotNegative,
    /// A learning rate: finite and not negative. One that is too large makes the run diverge, which
    /// is reported as an outcome.
    Rate,
    /// Between 0 and 1, both excluded.
    Between,
    /// From 0 to 1.
    Share,
    /// From 0 to below 1.
    BelowOne,
    /// A whole number from the first to the second.
    Within(usize, usize),
}

/// One row of the table of settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// Name; that of a length ends in its unit.
    pub name: &'static str,
    /// Kind of values it accepts.
    pub kind: Kind,
    /// Range of its numbers.
    pub domain: Domain,
    /// Unit, empty for none.
    pub unit: &'static str,
    /// Description in one sentence.
    pub sentence: &'static str,
}

impl Kind {
    /// The expected values, for messages.
    pub fn expected(self) -> String {
        let quoted = |names: &[&str]| -> Vec<String> {
            names.iter().map(|name| format!("'{name}'")).collect()
        };
        match self {
            Self::Number => "a number".to_owned(),
            Self::NumberOrNothing => "a number or None".to_owned(),
            Self::Count => "a whole number of at least 0".to_owned(),
            Self::CountOrNothing => "a whole number of at least 1, or None".to_owned(),
            Self::Switch => "True or False".to_owned(),
            Self::Pair => "two numbers".to_owned(),
            Self::NumbersOrNothing => "a sequence of numbers, or None".to_owned(),
            Self::OneOrEach => "a number, a sequence of numbers, or None".to_owned(),
            Self::Name([most @ .., last]) => {
                format!("{} or '{last}'", quoted(most).join(", "))
            }
            Self::Name([]) => "no value".to_owned(),
            Self::NumberOrName(name) => format!("a number, or '{name}'"),
        }
    }
}

/// Largest number of any setting and of a camera: squares and products of a few of them stay well
/// within the range of a double.
pub(crate) const MOST: f64 = 1e9;
/// What rounding to single precision may leave of a zero, an asymmetry or a negative variance,
/// relative to the other entries of a matrix.
pub(crate) const ROUNDING: f64 = 1e-6;
/// Smallest positive number of a setting.
const LEAST: f64 = 1e-15;

impl Setting {
    /// Whether `value` lies in the domain.
    /// Errors: [`Error::InvalidInput`] naming the setting and, for a sequence, the index.
    pub fn check(&self, value: &Value) -> Result<()> {
        let field = format!("config.{}", self.name);
        match value {
            Value::Number(x) => self.domain.check(field, *x),
            Value::Numbers(all) if self.kind == Kind::Pair => {
                all.iter().try_for_each(|x| self.domain.check(field.clone(), *x))
            }
            Value::Numbers(all) => {
                let mut each = all.iter().enumerate();
                each.try_for_each(|(k, x)| self.domain.check(format!("{field}[{k}]"), *x))
            }
            Value::Count(n) => self.domain.check_count(field, *n),
            _ => Ok(()),
        }
    }
}

impl Domain {
    fn check(self, field: String, value: f64) -> Result<()> {
        let fits = match self {
            Self::Any | Self::Within(..) => true,
            Self::Positive | Self::From(_) => value > 0.0 && value.is_finite(),
            Self::NotNegative | Self::Rate => value >= 0.0 && value.is_finite(),
            Self::Between => value > 0.0 && value < 1.0,
            Self::Share => (0.0..=1.0).contains(&value),
            Self::BelowOne => (0.0..1.0).contains(&value),
        };
        let too_far = match self {
            Self::Positive => !(LEAST..=MOST).contains(&value),
            Self::From(least) => !(least..=MOST).contains(&value),
            Self::NotNegative => value > MOST,
            _ => false,
        };
        match (fits, too_far) {
            (true, false) => Ok(()),
            (true, true) => Err(Error::invalid(field, self.range(), format!("{value:e}"))),
            (false, _) => Err(Error::invalid(field, self.words(), value.to_string())),
        }
    }

    fn check_count(self, field: String, n: usize) -> Result<()> {
        match self {
            Self::Within(least, most @ 0..10) if n < least || n > most => {
                let expected = format!("a whole number from {least} to {most}");
                Err(Error::invalid(field, expected, n.to_string()))
            }
            Self::Within(least, _) if n < least => {
                Err(Error::invalid(field, format!("at least {least}"), n.to_string()))
            }
            Self::Within(_, most) if n > most => {
                Err(Error::invalid(field, format!("at most {most}"), n.to_string()))
            }
            _ => Ok(()),
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Any | Self::Within(..) => "a number",
            Self::Positive | Self::From(_) => "a positive finite number",
            Self::NotNegative | Self::Rate => "a finite number that is not negative",
            Self::Between => "a number between 0 and 1",
            Self::Share => "a value in [0, 1]",
            Self::BelowOne => "values in [0, 1)",
        }
    }

    fn range(self) -> String {
        match self {
            Self::NotNegative => format!("a number of at most {MOST:e}"),
            Self::From(least) => format!("a number from {least:e} to {MOST:e}"),
            _ => format!("a number from {LEAST:e} to {MOST:e}"),
        }
    }
}

/// A type that a setting can have.
pub(crate) trait Parameter: Sized {
    const KIND: Kind;
    fn to_value(&self) -> Value;
    /// `None` if the value has the wrong kind.
    fn of_value(value: &Value) -> Option<Self>;
}

/// Makes a type one that a setting can have.
macro_rules! parameter {
    ($type:ty, $kind:expr, $name:ident => $to:expr, $($pattern:pat => $of:expr),+) => {
        impl Parameter for $type {
            const KIND: Kind = $kind;
            fn to_value(&self) -> Value {
                let $name = self;
                $to
            }
            fn of_value(value: &Value) -> Option<Self> {
                match value {
                    $($pattern => $of,)+
                    _ => None,
                }
            }
        }
    };
}
parameter!(f64, Kind::Number, x => Value::Number(*x), Value::Number(x) => Some(*x));
parameter!(usize, Kind::Count, n => Value::Count(*n), Value::Count(n) => Some(*n));
parameter!(u8, Kind::Count, n => Value::Count((*n).into()),
    Value::Count(n) => (*n).try_into().ok());
parameter!(bool, Kind::Switch, on => Value::Switch(*on), Value::Switch(on) => Some(*on));
parameter!([f64; 2], Kind::Pair, pair => Value::Numbers(pair.to_vec()),
    Value::Numbers(given) => given.as_slice().try_into().ok());
parameter!(Option<f64>, Kind::NumberOrNothing, x => x.map_or(Value::Nothing, Value::Number),
    Value::Number(x) => Some(Some(*x)), Value::Nothing => Some(None));
parameter!(Option<usize>, Kind::CountOrNothing, n => n.map_or(Value::Nothing, Value::Count),
    Value::Count(n) => Some(Some(*n)), Value::Nothing => Some(None));
parameter!(Option<Vec<f64>>, Kind::NumbersOrNothing,
    all => all.clone().map_or(Value::Nothing, Value::Numbers),
    Value::Numbers(all) => Some(Some(all.clone())), Value::Nothing => Some(None));

/// A struct of settings, one line each: `name: type = default, domain, unit, sentence;`. Fields
/// after `also` are not settings: they have only documentation and a default.
macro_rules! settings {
    (
        $(#[$meta:meta])*
        $name:ident {
            $($field:ident: $type:ty = $default:expr,
                $domain:expr, $unit:literal, $sentence:literal;)*
        }
        $(also { $($(#[$extra_meta:meta])* $extra:ident: $extra_type:ty = $extra_default:expr;)* })?
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name {
            $($($(#[$extra_meta])* pub $extra: $extra_type,)*)?
            $(#[doc = $sentence] pub $field: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($($extra: $extra_default,)*)? $($field: $default,)* }
            }
        }

        impl $name {
            /// The table of these settings.
            pub const SETTINGS: &'static [$crate::settings::Setting] = &[$(
                $crate::settings::Setting {
                    name: stringify!($field),
                    kind: <$type as $crate::settings::Parameter>::KIND,
                    domain: $domain,
                    unit: $unit,
                    sentence: $sentence,
                },
            )*];

            /// The value of a setting of this table.
            pub(crate) fn value(&self, name: &str) -> Option<$crate::settings::Value> {
                match name {
                    $(stringify!($field) => {
                        Some($crate::settings::Parameter::to_value(&self.$field))
                    })*
                    _ => None,
                }
            }

            /// Sets a setting of this table; returns whether the value has the right kind.
            pub(crate) fn set_value(
                &mut self,
                name: &str,
                value: &$crate::settings::Value,
            ) -> bool {
                match name {
                    $(stringify!($field) => {
                        let given = $crate::settings::Parameter::of_value(value);
                        given.map(|given| self.$field = given).is_some()
                    })*
                    _ => false,
                }
            }

            /// Checks that every setting of this table lies in its domain.
            pub(crate) fn check_domains(&self) -> $crate::error::Result<()> {
                Self::SETTINGS.iter().try_for_each(|setting| {
                    self.value(setting.name).map_or(Ok(()), |value| setting.check(&value))
                })
            }
        }
    };
}
pub(crate) use {parameter, settings};
