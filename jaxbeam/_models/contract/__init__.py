"""What a model is: equations of motion, matrices, loads on them, and their equilibrium.

Sources that the whole package cites by a letter, as in "Y eq. 19" and "B eqs. 64-65":

Y: H. H. Yoo, R. R. Ryan, R. A. Scott, Dynamics of flexible beams undergoing overall motions,
Journal of Sound and Vibration, 1995.
B: M. Berzeri, A. A. Shabana, A finite element study of the geometric centrifugal stiffening effect,
Technical Report MBS99-5-UIC, 1999.
"""
