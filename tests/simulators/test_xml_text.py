import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.errors import SetupError
from ftbias_jax.simulators.xml_text import Document, numbers

TEXT = """<?xml version='1.0'?>
<a  x = '1'><!-- <b y="no"/> -->
  <b y="a > b"
     z="2"/>
  <c>3</c>
</a>
"""


@pytest.fixture
def document(tmp_path):
    (tmp_path / "file.xml").write_text(TEXT)
    return Document(str(tmp_path / "file.xml"))


def test_attributes_change_where_they_stand(document):
    document.set(document.find("a")[0], "x", "9")
    document.set(document.find("b", z="2")[0], "y", None)
    document.set(document.find("b")[0], "w", "5")
    assert document.text == TEXT.replace("x = '1'", 'x="9"').replace('<b y="a > b"', '<b w="5"')


def test_what_is_put_in_has_a_line_of_its_own(document):
    document.insert(document.find("b")[0], "<d/>")
    document.insert(document.find("a")[0], "<e/>")
    root = ET.fromstring(document.text)
    assert [child.tag for child in root] == ["e", "b", "c"]
    assert root[1][0].tag == "d"
    assert '  <b y="a > b"\n     z="2">\n    <d/>\n  </b>' in document.text


def test_nothing_changed_is_the_same_text(document):
    assert document.text == TEXT
    assert not document.changed


@given(st.text(st.characters(codec="utf-8", exclude_characters="<&\"'\r\n\t", min_codepoint=32), max_size=9))
def test_other_letters_keep_their_place(tmp_path_factory, words):
    path = tmp_path_factory.getbasetemp() / "words.xml"
    path.write_text(f"<a n=\"{words}\"><!-- {words.replace('-', '')} --><b k='1'/></a>", encoding="utf-8")
    document = Document(str(path))
    document.set(document.find("b")[0], "k", "2")
    assert document.text == path.read_text(encoding="utf-8").replace("k='1'", 'k="2"')


def test_numbers_have_twelve_digits_and_no_minus_zero():
    assert numbers([-0.0, 1 / 3, 1e-7, -9.81]) == "0 0.333333333333 1e-07 -9.81"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<!DOCTYPE a [<!ENTITY e 'x'>]><a>&e;</a>", "document type"),
        (b"<a>", "is not valid XML"),
        (
            "<a b='\u00e4'/>".encode("latin-1").replace(b"<a", b"<?xml version='1.0' encoding='latin-1'?><a"),
            "is not UTF-8",
        ),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, content, words):
    (tmp_path / "file.xml").write_bytes(content)
    with pytest.raises(SetupError, match=words):
        Document(str(tmp_path / "file.xml"))
