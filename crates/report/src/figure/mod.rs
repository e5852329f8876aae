//! Pictures and drawings with captions.

mod encoded;
mod grid;
mod matches;
mod panel;

pub use encoded::Picture;
pub use grid::Grid;
pub use matches::{Line, side_by_side};
pub use panel::{ColorBar, Panel};

use crate::escape::escape;

/// Something to look at, with words below it.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    content: String,
    caption: String,
}

impl Figure {
    /// An encoded picture, shown `width` CSS pixels wide (less where the page is narrower).
    pub fn picture(picture: &Picture, width: usize, caption: &str) -> Self {
        let content =
            format!("<img src=\"{}\" width=\"{width}\" alt=\"{}\">", picture.data_uri(), escape(caption));
        Self { content, caption: caption.to_owned() }
    }

    /// A drawing made by this crate (it goes into the page as it is).
    pub fn svg(svg: String, caption: &str) -> Self {
        Self { content: svg, caption: caption.to_owned() }
    }

    /// A drawing whose group of the class `lines` is shown when its box is ticked.
    pub fn with_lines_on_demand(svg: String, caption: &str, label: &str) -> Self {
        let toggle = format!("<label class=\"toggle\"><input type=\"checkbox\"> {}</label>\n", escape(label));
        Self { content: toggle + &svg, caption: caption.to_owned() }
    }

    pub(crate) fn html(&self) -> String {
        format!("<figure>\n{}\n<figcaption>{}</figcaption>\n</figure>\n", self.content, escape(&self.caption))
    }
}

/// The beginning of a drawing of this size, CSS pixels.
fn open_svg(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.1} {height:.1}\" width=\"{width:.0}\" height=\"{height:.0}\" \
         role=\"img\" font-family=\"system-ui, Segoe UI, Roboto, Helvetica Neue, Arial, sans-serif\" font-size=\"11.5\" class=\"drawing\" fill=\"#1c1c20\">\n\
         <rect class=\"paper\" width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
    )
}

/// A picture inside a drawing.
fn image(picture: &Picture, x: f64, y: f64, width: f64, height: f64) -> String {
    format!(
        "<image x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" preserveAspectRatio=\"none\" href=\"{}\"/>\n",
        picture.data_uri()
    )
}

#[cfg(test)]
mod tests;
