"""What is on a page of HTML."""

from html.parser import HTMLParser

VOID = {"meta", "line", "rect", "circle", "path", "link", "br", "img"}


class Page(HTMLParser):
    """Elements and texts of a page; every element must be closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags, self.attributes, self.headings, self.text, self._open = [], [], [], "", []
        self.feed(html)
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.text += data
        if self._open and self._open[-1] == "h2":
            self.headings.append(data)

    def values(self, *names):
        """Values of the attributes of these names."""
        return [value for name, value in self.attributes if name in names]
