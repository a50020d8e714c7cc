"""Reading recordings from files, and the recordings that come with the package.

Examples
--------
>>> import greybox_id as gb
>>> gb.datasets.shipped("racer_train").name
'racer_train.csv'
"""

from .shipped import shipped as shipped

__all__ = ["shipped"]
