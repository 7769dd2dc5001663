"""A diagnosis step by step: refit, try, add and remove effects."""

from visaug.diagnosis.session.session import Session, Setup

__all__ = ["Session", "Setup"]
