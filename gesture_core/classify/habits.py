"""What scikit-learn asks of a classifier, without needing scikit-learn."""

from __future__ import annotations

from inspect import signature
from typing import Any, Self

from gesture_core.errors import ConfigError


class ClassifierHabits:
    """Parameters by the names of the constructor, tags, and whether it is fitted."""

    _estimator_type = "classifier"

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The parameters of the constructor (scikit-learn)."""
        return {name: getattr(self, name) for name in signature(type(self)).parameters}

    def set_params(self, **params: Any) -> Self:
        """Change parameters of the constructor (scikit-learn)."""
        for name, value in params.items():
            if name not in self.get_params():
                raise ConfigError(
                    f"{type(self).__name__} has no parameter {name!r}",
                    remedy=f"one of {', '.join(self.get_params())}",
                    code="E_OPTION",
                )
            setattr(self, name, value)
        return self

    def __sklearn_tags__(self) -> Any:
        """Tags that scikit-learn asks for; only it calls this, so it is installed."""
        from sklearn.utils import ClassifierTags, InputTags, Tags, TargetTags

        return Tags(
            estimator_type="classifier",
            target_tags=TargetTags(required=True),
            classifier_tags=ClassifierTags(),
            input_tags=InputTags(two_d_array=False, three_d_array=True, allow_nan=True),
        )

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "library_")
