//! One HTML page that holds everything it shows.

use crate::escape::escape;
use crate::figure::Figure;
use crate::points::{PointView, SCRIPT};
use crate::table::{Table, definitions};

const STYLE: &str = include_str!("page.css");

/// A page in the making: sections, one after the other.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    lead: String,
    contents: Vec<String>,
    body: String,
    section_open: bool,
    num_point_views: usize,
}

impl Page {
    /// An empty one.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            lead: String::new(),
            contents: Vec::new(),
            body: String::new(),
            section_open: false,
            num_point_views: 0,
        }
    }

    /// One sentence below the title: what this page says.
    pub fn lead(&mut self, text: &str) -> &mut Self {
        self.lead = format!("<p class=\"lead\">{}</p>\n", escape(text));
        self
    }

    /// Begins a section; it is listed in the contents.
    pub fn section(&mut self, heading: &str) -> &mut Self {
        self.close_section();
        let number = self.contents.len() + 1;
        self.contents.push(escape(heading));
        self.body += &format!("<section id=\"s{number}\">\n<h2>{}</h2>\n", escape(heading));
        self.section_open = true;
        self
    }

    /// A smaller heading inside a section.
    pub fn heading(&mut self, text: &str) -> &mut Self {
        self.body += &format!("<h3>{}</h3>\n", escape(text));
        self
    }

    /// A paragraph of plain text.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.body += &format!("<p>{}</p>\n", escape(text));
        self
    }

    /// What the reader must not overlook.
    pub fn warning(&mut self, text: &str) -> &mut Self {
        self.body += &format!("<p class=\"warning\">{}</p>\n", escape(text));
        self
    }

    /// A list.
    pub fn list<T: AsRef<str>>(&mut self, items: impl IntoIterator<Item = T>) -> &mut Self {
        let items: String =
            items.into_iter().map(|item| format!("<li>{}</li>\n", escape(item.as_ref()))).collect();
        self.body += &format!("<ul>\n{items}</ul>\n");
        self
    }

    /// Links to files beside the page, by relative path, each with its words.
    pub fn links<'a>(&mut self, links: impl IntoIterator<Item = (&'a str, &'a str)>) -> &mut Self {
        let items: String = links
            .into_iter()
            .map(|(path, words)| format!("<li><a href=\"{}\">{}</a></li>\n", escape(path), escape(words)))
            .collect();
        self.body += &format!("<ul>\n{items}</ul>\n");
        self
    }

    /// Text as it stands in a file, folded away until asked for.
    pub fn listing(&mut self, summary: &str, text: &str) -> &mut Self {
        self.body += &format!(
            "<details><summary>{}</summary><pre>{}</pre></details>\n",
            escape(summary),
            escape(text)
        );
        self
    }

    /// Whatever `fill` adds, folded away until asked for.
    pub fn folded<R>(&mut self, summary: &str, fill: impl FnOnce(&mut Self) -> R) -> R {
        self.body += &format!("<details><summary>{}</summary>\n", escape(summary));
        let filled = fill(self);
        self.body += "</details>\n";
        filled
    }

    /// Words and what they mean, folded away.
    pub fn definitions<'a>(
        &mut self,
        summary: &str,
        defined: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> &mut Self {
        self.body += &definitions(summary, defined);
        self
    }

    /// The few numbers that answer the reader's question, large: each with its unit and what it is.
    pub fn key_numbers<'a>(&mut self, numbers: impl IntoIterator<Item = (String, &'a str)>) -> &mut Self {
        let numbers: String = numbers
            .into_iter()
            .map(|(number, words)| {
                format!("<div><b>{}</b><span>{}</span></div>\n", escape(&number), escape(words))
            })
            .collect();
        self.body += &format!("<div class=\"numbers\">\n{numbers}</div>\n");
        self
    }

    /// A table.
    pub fn table(&mut self, table: &Table) -> &mut Self {
        self.body += &table.html();
        self
    }

    /// A figure over the page's width.
    pub fn figure(&mut self, figure: &Figure) -> &mut Self {
        self.body += &figure.html();
        self
    }

    /// Figures side by side, as many as fit.
    pub fn figures<'a>(&mut self, figures: impl IntoIterator<Item = &'a Figure>) -> &mut Self {
        let figures: String = figures.into_iter().map(Figure::html).collect();
        self.body += &format!("<div class=\"row\">\n{figures}</div>\n");
        self
    }

    /// A cloud of points to turn and to come close to.
    pub fn points(&mut self, view: &PointView, caption: &str) -> &mut Self {
        self.num_point_views += 1;
        self.body += &view.html(self.num_point_views, caption);
        self
    }

    fn close_section(&mut self) {
        if self.section_open {
            self.body += "</section>\n";
            self.section_open = false;
        }
    }

    /// The whole page.
    pub fn finish(mut self) -> String {
        self.close_section();
        let links = self
            .contents
            .iter()
            .enumerate()
            .map(|(k, heading)| format!("<a href=\"#s{}\">{heading}</a>", k + 1))
            .collect::<Vec<_>>()
            .join(" · ");
        let contents = if self.contents.len() > 2 { format!("<nav>{links}</nav>\n") } else { String::new() };
        let script =
            if self.num_point_views > 0 { format!("<script>\n{SCRIPT}</script>\n") } else { String::new() };
        let title = escape(&self.title);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n{}{contents}{}</main>\n\
             {script}</body>\n</html>\n",
            self.lead, self.body
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_whole_and_fetches_nothing() {
        let mut page = Page::new("A <b> & B");
        page.lead("what <it> says");
        for name in ["One", "Two", "Three"] {
            page.section(name)
                .paragraph("x < y")
                .warning("careful")
                .list(["a", "b"])
                .listing("more", "</pre>");
        }
        page.folded("rest <of> it", |page| {
            page.paragraph("inside").definitions("words", [("a", "b")]).list(["c"]).section_open
        });
        page.key_numbers([("0.02°".to_owned(), "the pose")]);
        let html = page.finish();
        assert!(html.starts_with("<!DOCTYPE html>") && html.ends_with("</html>\n"));
        assert_eq!(html.matches("<section").count(), html.matches("</section>").count());
        assert!(html.contains("<title>A &lt;b&gt; &amp; B</title>") && html.contains("&lt;/pre&gt;"));
        assert!(html.contains("rest &lt;of&gt; it") && html.contains("<b>0.02°</b><span>the pose</span>"));
        assert_eq!(html.matches("<details").count(), html.matches("</details>").count());
        assert!(html.contains("<a href=\"#s3\">Three</a>"));
        for fetched in ["http://", "https://", "src=\"/", "@import", "<link"] {
            assert!(!html.contains(fetched), "{fetched}");
        }
        assert!(!html.contains("<script>"), "a page without points needs none");
    }
}
