"""Reality made by other people's physics: simulators that share neither code nor functional forms with the models.

`families` lists them and says which serve calibration and which serve examinations. Nothing here is imported by a
diagnosis.
"""
