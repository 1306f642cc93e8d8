"""Where a log departs from the model, which effect causes it, and how far the gap shrinks once it is modelled."""

from ftbias_jax.diagnosis.apply import setup_with_causes
from ftbias_jax.diagnosis.report.as_json import save_json
from ftbias_jax.diagnosis.report.html import save_html
from ftbias_jax.diagnosis.report.tables import to_table
from ftbias_jax.diagnosis.result import Diagnosis

Diagnosis.__str__ = to_table  # type: ignore[method-assign, assignment]
Diagnosis.to_html = save_html  # type: ignore[method-assign, assignment]
Diagnosis.to_json = save_json  # type: ignore[method-assign, assignment]
Diagnosis.apply = setup_with_causes  # type: ignore[method-assign, assignment]
