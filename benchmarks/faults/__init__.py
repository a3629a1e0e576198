"""Log checks against injected faults: kinds x strengths x robots, and false alarms on the clean logs.

A trial is a case and the columns of a log. A kind of fault changes the columns, or what the case says of them. Where a
fault has a strength, the smallest one is the one that moves the held-out error or an identified parameter by 5 %.
"""
